"""The log of a process: one line per event on standard error, regardless of the texts' content."""

import logging
import time


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
