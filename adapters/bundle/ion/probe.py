"""Whether ION answers: a process that died within ION can leave its database locked for ever."""

import shutil
import subprocess
import threading
from typing import Final

_ADMIN: Final = "bpadmin"


class Probe:
    """Asks bpadmin for an endpoint, now and then, on a thread of its own.

    One that does not return is waited for, and never killed: that could leave the lock behind.

    Args:
        own: the endpoint.
        every_s: how often.
        answer_s: how long an answer may take.

    Attributes:
        answers: whether ION answered last; true where there is no bpadmin to ask.
    """

    def __init__(self, own: str, every_s: float, answer_s: float) -> None:
        """Prepare; see `start`."""
        self.answers = True
        self._question = f"i endpoint {own}\nq\n".encode("ascii")
        self._every_s, self._answer_s = every_s, answer_s
        self._over = threading.Event()

    def start(self) -> None:
        """Begin to ask, if there is whom to ask."""
        if (program := shutil.which(_ADMIN)) is not None:
            threading.Thread(target=self._ask_on, args=(program,), daemon=True).start()

    def stop(self) -> None:
        """Ask no more."""
        self._over.set()

    def _ask_on(self, program: str) -> None:
        while not self._over.wait(self._every_s):
            try:
                self._ask(program)
            except OSError:
                self.answers = False

    def _ask(self, program: str) -> None:
        asked = subprocess.Popen(
            [program],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            asked.communicate(self._question, self._answer_s)
        except subprocess.TimeoutExpired:
            self.answers = False
            asked.communicate()
        self.answers = True
