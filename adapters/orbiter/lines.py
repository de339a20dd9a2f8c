"""Lines of the operator's view: time, what it is, whose it is, what it says (thesis fig. 11)."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from adapters.mops.dictionary import Dictionary
    from adapters.mrs.types import Notification, ParameterValue

CONTACT: Final = "CONTACT"
"""The first word of what is said of the way to a rover, not to the rover."""
_WIDTH = 9


def line(utc_s: float, kind: str, *said: str) -> str:
    """Return a line: time in UTC, one word, the rest; what is not printable is a `?`."""
    time = datetime.fromtimestamp(utc_s, UTC)
    head = f"{time:%H:%M:%S}.{time.microsecond // 1000:03d}Z {kind:<{_WIDTH}}"
    whole = " ".join((head, *filter(None, said))).rstrip()
    return "".join(each if each.isprintable() else "?" for each in whole)


def notification_line(notification: "Notification") -> str:
    """Return the line of a notification; a command's stage is its word."""
    utc_s, text = notification.timestamp / 1e9, notification.text or ""
    if notification.stage is None:
        severity = notification.severity.name
        return line(utc_s, notification.kind.name, severity, text)
    whose = f"{notification.source}:{notification.commandId}"
    steps = "" if notification.step is None else f"{notification.step}/{notification.stepCount}"
    code = "" if notification.code is None else f"reason {notification.code}:"
    return line(utc_s, notification.stage.name, whose, steps, code, text)


def values_line(kind: str, values: "Sequence[ParameterValue]") -> str:
    """Return the line of parameters, `-` where one is not known."""
    figures = (
        f"{value.name}={'-' if value.value is None else format(value.value.value, 'z.3f')}"
        for value in values
    )
    return line(max(value.timestamp for value in values) / 1e9, kind, *figures)


def help_lines(dictionary: "Dictionary") -> list[str]:
    """Return what can be typed."""
    commands = dictionary.spelling.commands.items()
    return [
        *(f"  {' '.join((name, *map(str.upper, entry.inputs)))}" for name, entry in commands),
        "  contact   up, down or plan: open or close the way from the orbiter, or as planned",
        "  status    telemetry and relay, as they are now",
        "  help      this list",
        "  quit      end, whatever is under way",
        "m, rad, s; - for what is not given; words with spaces in quotes",
    ]
