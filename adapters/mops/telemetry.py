"""Converts telemetry, link health and housekeeping to MOPS messages, and back."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Final

from adapters.mops.codec import (
    MAX_UTC_S,
    Message,
    MopsError,
    from_values,
    require_within,
    values_of,
)
from adapters.mops.dictionary import OtherEntry, TelemetryEntry
from adapters.mops.reports import TO_ALL
from executive.commands import Mode
from executive.values.facts import Battery, CameraAngles, Odometry
from executive.values.geometry import Pose, Velocity
from executive.values.parameters import Parameter, ParameterValue

_NAME: Final = re.compile(r"[A-Z][A-Z0-9_]{0,39}", re.ASCII)
_MAX_FIGURES: Final = 64


@dataclass(frozen=True, slots=True)
class LinkHealth:
    """Counters and state of the bundle agent at one end of the relay link.

    Attributes:
        utc_s: time of the values, seconds since 1970-01-01 UTC.
        queued: bundles queued for transmission.
        oldest_age_s: age in the queue of the first of them, s.
        next_contact_utc_s: start of the next planned contact; None if none is planned.
        last_received_s: time since the last reception from the other end, s; None for never.
        undelivered: bundles queued for publication.
        refused: messages refused since the start.
        contact: whether it could send to the other end; None, like all below, if the end runs a
            version without these values.
        queued_octets: size of the bundles queued for transmission.
        sent, acknowledged, retransmitted, expired, received: traffic of its link since the start,
            as in `adapters.bundle.Traffic`.
        round_trip_s: last response time of the other end, s; None before the first response.
    """

    utc_s: float
    queued: int
    oldest_age_s: float
    next_contact_utc_s: float | None
    last_received_s: float | None
    undelivered: int
    refused: int
    contact: bool | None = None
    queued_octets: int | None = None
    sent: int | None = None
    acknowledged: int | None = None
    retransmitted: int | None = None
    expired: int | None = None
    received: int | None = None
    round_trip_s: float | None = None


_REQUIRED_VALUES: Final = 7
"""Number of values of LinkHealth that every version sends."""


def health_message(health: LinkHealth, entry: OtherEntry, source: str) -> Message:
    """Return the message that carries link health.

    Raises:
        MopsError: a number is not finite.
    """
    outputs = tuple(values_of(health))
    return Message(entry.code, source, TO_ALL, entry.command, outputs=outputs, received=True)


def health_of(message: Message, entry: OtherEntry) -> LinkHealth:
    """Return the link health that a message carries.

    Raises:
        MopsError: it is not a link health message, or a value is invalid.
    """
    if (message.code, message.command) != (entry.code, entry.command) or message.inputs:
        raise MopsError(f"{message.code:03X} {message.command} is no link health")
    missing = len(LinkHealth.__slots__) - len(message.outputs)
    if missing and len(message.outputs) != _REQUIRED_VALUES:
        raise MopsError(f"outputs: {len(message.outputs)}, not {len(LinkHealth.__slots__)}")
    health: LinkHealth = from_values(LinkHealth, (*message.outputs, *missing * ("",)))
    require_within("utc_s", health.utc_s, 0, MAX_UTC_S)
    return health


def telemetry_of(
    known: Mapping[Parameter, float | None],
    spelling: TelemetryEntry,
    source: str,
    dest: str,
    mode: Mode | None = None,
) -> Message:
    """Return telemetry: all parameters, empty if unknown, and the mode if given.

    A brick has no mode.
    """
    values = [known.get(parameter) for parameter in spelling.outputs]
    texts = tuple("" if value is None else repr(float(value)) for value in values)
    return Message(
        spelling.code,
        source,
        dest,
        spelling.command,
        outputs=texts if mode is None else (*texts, mode.name),
        received=True,
    )


def parameters_of(
    message: Message, spelling: TelemetryEntry, utc_s: float
) -> tuple[ParameterValue, ...]:
    """Return the parameters of a telemetry message; unknown ones are None.

    Args:
        message: telemetry.
        spelling: the parameters in their order.
        utc_s: time of transmission; the message does not carry it.

    Raises:
        MopsError: it is not telemetry, or a value is not a number.
    """
    values = _values(message, spelling)
    for parameter, value in values.items():
        if value is not None and not isfinite(value):
            raise MopsError(f"{parameter.value}: {value!r} is no finite number")
    return tuple(ParameterValue(parameter, utc_s, value) for parameter, value in values.items())


def mode_of(message: Message, spelling: TelemetryEntry) -> Mode | None:
    """Return the mode in a telemetry message; None if absent.

    Raises:
        MopsError: the mode is unknown.
    """
    for name in message.outputs[len(spelling.outputs) :]:
        if name not in Mode.__members__:
            raise MopsError(f"outputs: {name[:40]!r} is no mode")
        return Mode[name]
    return None


def facts_of(
    message: Message, spelling: TelemetryEntry, stamp_s: float
) -> Iterator[Odometry | Battery | CameraAngles]:
    """Yield the facts in a telemetry message, also non-finite ones; unknown values are omitted.

    Args:
        message: telemetry.
        spelling: the parameters in their order.
        stamp_s: time of reception, s.

    Raises:
        MopsError: it is not telemetry, or a value is not a number.
    """
    known = {name: value for name, value in _values(message, spelling).items() if value is not None}
    position = _all(known, (Parameter.POS_X, Parameter.POS_Y, Parameter.HEAD))
    speeds = _all(known, (Parameter.CURRENT_TRAVEL_SPEED, Parameter.CURRENT_ROTATE_SPEED))
    if position and speeds:
        x_m, y_m, heading_rad = position
        pose = Pose(x_m, y_m, known.get(Parameter.POS_Z, 0.0), heading_rad)
        yield Odometry(stamp_s, pose, Velocity(*speeds))
    if Parameter.BATERY_VOLTAGE in known:
        yield Battery(known[Parameter.BATERY_VOLTAGE])
    angles = _all(known, (Parameter.CAM_PAN, Parameter.CAM_TILT))
    if angles:
        yield CameraAngles(*angles)


def _all(known: dict[Parameter, float], wanted: Sequence[Parameter]) -> list[float]:
    found = [known[parameter] for parameter in wanted if parameter in known]
    return found if len(found) == len(wanted) else []


def _values(message: Message, spelling: TelemetryEntry) -> dict[Parameter, float | None]:
    """Return the value of each parameter in a telemetry message, in order; None if unknown.

    Raises:
        MopsError: it is not telemetry, or a value is not a number.
    """
    if (message.code, message.command) != (spelling.code, spelling.command):
        raise MopsError(f"{message.code:03X} {message.command} is no telemetry")
    count = len(spelling.outputs)
    if len(message.outputs) not in (count, count + 1):
        raise MopsError(f"outputs: {len(message.outputs)}, not {count} or {count + 1}")
    return {
        parameter: _number(parameter.value, text) if text else None
        for parameter, text in zip(spelling.outputs, message.outputs[:count], strict=True)
    }


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError as fault:
        raise MopsError(f"{name}: {text[:40]!r} is no number") from fault


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
    figure = _number(name, text)
    if not isfinite(figure):
        raise MopsError(f"{name}: {text[:40]!r} is not finite")
    return figure
