"""Standard output of a program: closed pipe, full disk, terminal without UTF-8."""

import codecs
import errno
import io
import logging
import os
import sys
from threading import current_thread, main_thread
from typing import Any, Final

UNREAD: Final = 141
"""Exit status if the output is closed: the value that a shell reports for SIGPIPE."""

_PLAIN: Final = "rover.plain"
_SPELLED: Final = str.maketrans(
    "×−–²µ·“”→⇉◆◇▸●✓✕↓↑←│├└─", "x--2u.''>=#o>*+xv^<||`-"
) | str.maketrans({"±": "+-", "…": "...", "°": "deg"})
"""ASCII for the product's symbols on a terminal without UTF-8; other letters become `?`."""


def guard_output() -> None:
    """End the program with an exit status, not a traceback, if standard output fails.

    Every writer, such as click or rich, gets SystemExit if the output cannot be written.
    Symbols that the terminal's encoding lacks are replaced by ASCII.
    """
    stdout = sys.stdout
    if stdout is None:  # closed by the parent process
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    elif stdout is sys.__stdout__ and isinstance(stdout, io.TextIOWrapper):
        raw = io.BufferedWriter(_Output(stdout.fileno(), "w", closefd=False))
        buffered = stdout.line_buffering or stdout.write_through
        sys.stdout = io.TextIOWrapper(raw, stdout.encoding, _PLAIN, line_buffering=buffered)


class _Output(io.FileIO):
    """Standard output; fails once, and in the main thread, so that its exit ends the program."""

    _lost = False

    def write(self, octets: Any, /) -> int:
        """Write octets, or raise SystemExit: with `UNREAD`, or a text for standard error."""
        if self._lost:
            return memoryview(octets).nbytes
        try:
            return super().write(octets)
        except OSError as error:
            self._lost = current_thread() is main_thread()
            logging.getLogger("asyncio").disabled = True  # an exit in a task is no lost exception
            if error.errno == errno.EPIPE:
                raise SystemExit(UNREAD) from None
            raise SystemExit(f"Error: output cannot be written: {error.strerror}") from None


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII for symbols that an encoding lacks; an error handler of `codecs`."""
    assert isinstance(error, UnicodeEncodeError)
    spelled = error.object[error.start : error.end].translate(_SPELLED)
    return spelled.encode("ascii", "replace").decode(), error.end


codecs.register_error(_PLAIN, _spell)
