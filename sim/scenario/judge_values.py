"""Findings about telemetry."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

from executive.geometry import wrap_rad
from executive.parameters import DEFINITIONS, Parameter
from sim.scenario.expectations import ParameterIs, TelemetryCount
from sim.scenario.finding import NEVER, Finding
from sim.scenario.record import HeardValue, Record

_UNITS: Final = {definition.parameter: definition.unit for definition in DEFINITIONS}


def parameter(expected: ParameterIs, record: Record) -> Finding:
    """Compare the values of a parameter in telemetry, or in the answer to a question."""
    unit = _UNITS[expected.parameter]
    when = expected.period if expected.asked is None else f"asked by {expected.asked}"
    subject = expected.parameter.value
    wanted = f"{expected.value:.4g} ± {expected.tolerance:.4g} {unit} {when}"
    seen = [each.value for each in _looked_at(expected, record)]
    if not seen:
        return Finding(subject, wanted, "no value came", False)
    known = [value for value in seen if value is not None]
    if len(known) < len(seen):
        return Finding(subject, wanted, "not known aboard", False)
    worst = max(known, key=lambda value: _distance(expected, value))
    count = f", the worst of {len(known)}" if len(known) > 1 else ""
    holds = _distance(expected, worst) <= expected.tolerance
    return Finding(subject, wanted, f"{worst:.4g} {unit}{count}", holds)


def telemetry(expected: TelemetryCount, record: Record) -> Finding:
    """Count how often each parameter arrived in a while."""
    wanted = f"{expected.telemetry} ± {expected.tolerance} × each parameter {expected.period}"
    if record.moment(expected) is None:
        return Finding("telemetry", wanted, NEVER, False)
    heard = Counter(value.parameter for value in record.during(record.values, expected))
    counts = sorted(heard[each] for each in Parameter)
    return Finding(
        "telemetry",
        wanted,
        f"{counts[0]} to {counts[-1]} ×" if counts[0] < counts[-1] else f"{counts[0]} ×",
        all(abs(count - expected.telemetry) <= expected.tolerance for count in counts),
    )


def _looked_at(expected: ParameterIs, record: Record) -> Sequence[HeardValue]:
    wanted = expected.parameter
    if expected.asked is not None:
        answers = [asked.values for asked in record.answers if asked.label == expected.asked]
        return [value for values in answers for value in values if value.parameter is wanted]
    heard = [value for value in record.values if value.parameter is wanted]
    if expected.for_s:
        return record.during(heard, expected)
    first = record.sample(heard, expected)
    return [] if first is None else [first]


def _distance(expected: ParameterIs, value: float) -> float:
    difference = value - expected.value
    return abs(wrap_rad(difference) if expected.parameter is Parameter.HEAD else difference)
