"""`guard_output`, `log_to_stderr`: standard output of a program, its log on standard error.

Standard output may be a closed pipe, a full disk or a terminal without UTF-8. The log has one line
per event, regardless of the texts' content.
"""

import codecs
import errno
import io
import logging
import os
import sys
import time
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


class OneLineFormatter(logging.Formatter):
    """UTC, level and text on one line; control characters and line ends are escaped.

    Texts also contain input of peers: none may imitate a line of the log, or control a terminal.
    The lines of a traceback follow, each indented.
    """

    converter = staticmethod(time.gmtime)
    default_time_format = "%Y-%m-%dT%H:%M:%S"
    default_msec_format = "%s.%03dZ"

    def __init__(self) -> None:
        from executive.values.reports import printable  # `rover --help` imports no package

        self._printable = printable
        super().__init__("%(asctime)s %(levelname)-7s %(message)s")

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """Return the line of a record."""
        record.message = self._printable(record.message)
        return super().formatMessage(record)

    def formatException(self, ei: object) -> str:  # noqa: N802 - logging's name
        """Return the lines of a traceback."""
        text = super().formatException(ei)  # type: ignore[arg-type]
        return "\n".join(f"  {self._printable(line)}" for line in text.split("\n"))


def log_to_stderr(level: str) -> None:
    """Log to standard error from a level upwards."""
    handler = logging.StreamHandler()
    handler.setFormatter(OneLineFormatter())
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("transitions").setLevel(logging.WARNING)  # logs every stage of a life cycle
