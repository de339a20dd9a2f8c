"""Starts the bridge to ION, and lets it end in its own time."""

import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

from adapters.bundle.attached.settings import IonSettings
from adapters.bundle.eid import Eid

_ROOT = Path(__file__).resolve().parents[3]


class BridgeProcess:
    """A bridge, in a session of its own, so that no signal to a terminal or a group finds it.

    It is never killed: SIGKILL within ION can leave the database of the node locked.

    Args:
        settings: the interpreter that has pyion, and more.
        own: the endpoint.
        spool: the file of what ION has forgotten and the agent has not yet.

    Attributes:
        socket: our end of the socket between.

    Raises:
        OSError: it cannot be started.
    """

    def __init__(self, settings: IonSettings, own: Eid, spool: Path) -> None:
        """Start it."""
        ours, its = socket.socketpair()
        with its:
            try:
                self._process = subprocess.Popen(
                    [
                        settings.python or sys.executable, "-m", "adapters.bundle.ion.bridge",
                        "--fd", str(its.fileno()),
                        "--own", str(own),
                        "--spool", str(spool.absolute()),
                        "--look-s", str(settings.look_s),
                        "--answer-s", str(settings.answer_s),
                    ],
                    env=_environment(settings),
                    pass_fds=(its.fileno(),),
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    start_new_session=True,
                )  # fmt: skip
            except BaseException:
                ours.close()
                raise
        self.socket = ours

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    def ask_to_end(self) -> None:
        """Send SIGTERM."""
        self._process.terminate()

    def leave(self) -> None:
        """Let it end in its own time; somebody has to hear of it, or it stays as a zombie."""
        if self._process.poll() is None:
            threading.Thread(target=self._process.wait, daemon=True).start()

    def wait(self, limit_s: float) -> bool:
        """Wait for its end, but not for ever; return whether it has ended."""
        try:
            self._process.wait(limit_s)
        except subprocess.TimeoutExpired:
            return False
        return True


def _environment(settings: IonSettings) -> dict[str, str]:
    paths = [str(_ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}
    if settings.node_list is not None:
        environment["ION_NODE_LIST_DIR"] = settings.node_list
    return environment
