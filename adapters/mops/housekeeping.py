"""Conversion between the housekeeping of an onboard component and a MOPS message."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Final

from adapters.mops.codec import MAX_UTC_S, Message, MopsError, require_within
from adapters.mops.dictionary import OtherEntry
from adapters.mops.reports import TO_ALL

_NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,39}", re.ASCII)
_MAX_FIGURES: Final = 64


@dataclass(frozen=True, slots=True)
class Housekeeping:
    """Health figures of a component.

    Attributes:
        utc_s: time of the figures, seconds since 1970-01-01 UTC.
        figures: value of each parameter, by its name; None if unknown.
    """

    utc_s: float
    figures: Mapping[str, float | None]


def housekeeping_message(housekeeping: Housekeeping, entry: OtherEntry, source: str) -> Message:
    """Return the message that carries housekeeping."""
    outputs = [repr(housekeeping.utc_s)]
    for name, figure in housekeeping.figures.items():
        outputs += [name, "" if figure is None else repr(float(figure))]
    return Message(entry.code, source, TO_ALL, entry.command, outputs=tuple(outputs), received=True)


def housekeeping_of(message: Message, entry: OtherEntry) -> Housekeeping:
    """Return the housekeeping that a message carries.

    Raises:
        MopsError: it is not housekeeping, or a value is invalid.
    """
    if (message.code, message.command) != (entry.code, entry.command) or message.inputs:
        raise MopsError(f"{message.code:03X} {message.command} is no housekeeping")
    time, *pairs = message.outputs or ("",)
    utc_s = _figure("utc_s", time)
    require_within("utc_s", utc_s, 0, MAX_UTC_S)
    if len(pairs) % 2 or len(pairs) > 2 * _MAX_FIGURES:
        raise MopsError(f"outputs: a time, and {_MAX_FIGURES} names at most with a value each")
    figures: dict[str, float | None] = {}
    for name, text in zip(pairs[::2], pairs[1::2], strict=True):
        if not _NAME.fullmatch(name) or name in figures:
            raise MopsError(f"outputs: {name[:40]!r} is no name, or is there twice")
        figures[name] = _figure(name, text) if text else None
    return Housekeeping(utc_s, figures)


def _figure(name: str, text: str) -> float:
    try:
        figure = float(text)
    except ValueError as fault:
        raise MopsError(f"{name}: {text[:40]!r} is no number") from fault
    if not isfinite(figure):
        raise MopsError(f"{name}: {text[:40]!r} is not finite")
    return figure
