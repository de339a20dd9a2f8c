"""The log of a process: one line an event on standard error, whatever is in the texts."""

import logging
import time


class OneLineFormatter(logging.Formatter):
    """UTC, level and text on one line; control characters and line ends are escaped.

    Texts come from peers, too: none may look like a line of its own, or command a terminal. The
    lines of a traceback follow, each set in.
    """

    converter = staticmethod(time.gmtime)
    default_time_format = "%Y-%m-%dT%H:%M:%S"
    default_msec_format = "%s.%03dZ"

    def __init__(self) -> None:
        from executive.values.reports import printable  # `rover --help` imports no room

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
    """Log what is at least of a level."""
    handler = logging.StreamHandler()
    handler.setFormatter(OneLineFormatter())
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)
    logging.getLogger("transitions").setLevel(logging.WARNING)  # tells every step of a life
