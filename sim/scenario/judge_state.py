"""Findings about the rover: where it truly is, its mode, its telemetry, its pictures."""

from collections import Counter
from collections.abc import Sequence
from io import BytesIO
from itertools import groupby
from math import degrees, hypot, radians
from typing import Final

from executive.commands import Mode
from executive.geometry import wrap_rad
from executive.state import DEFINITIONS, Parameter
from sim.scenario.expectations import (
    ModeIs,
    Movement,
    ParameterIs,
    Pictures,
    PoseIs,
    RoverMoves,
    TelemetryCount,
    VideoComes,
)
from sim.scenario.finding import NEVER, Finding
from sim.scenario.record import HeardValue, Record, TruePose, between

STILL_M: Final = 0.02
STILL_RAD: Final = radians(2.0)
"""A rover stands that stays within these of where it was."""
BRAKING_S: Final = 1.5
"""After this long in STOPPED or SAFE the rover has come to rest, from whatever speed."""
HELD: Final = frozenset({Mode.STOPPED, Mode.SAFE})


def pose(expected: PoseIs, record: Record) -> Finding:
    """Compare the true pose at a time."""
    place = expected.pose
    wanted = f"x {place.x_m:.2f} y {place.y_m:.2f} ± {expected.tolerance_m:g} m"
    if place.heading_rad is not None:
        wanted += f", {_angle(place.heading_rad)} ± {_angle(expected.heading_tolerance_rad)}"
    wanted += f" {expected.when}"
    seen = record.sample(record.poses, expected)
    if seen is None:
        return Finding("true pose", wanted, NEVER, False)
    true = seen.pose
    away_m = hypot(true.x_m - place.x_m, true.y_m - place.y_m)
    found = f"x {true.x_m:.3f} y {true.y_m:.3f}, {away_m:.3f} m off"
    holds = away_m <= expected.tolerance_m
    if place.heading_rad is not None:
        off_rad = abs(wrap_rad(true.heading_rad - place.heading_rad))
        found += f", {_angle(true.heading_rad)}, {_angle(off_rad)} off"
        holds = holds and off_rad <= expected.heading_tolerance_rad
    return Finding("true pose", wanted, found, holds)


def movement(expected: RoverMoves, record: Record) -> Finding:
    """Look whether the rover moves in a while."""
    wanted = f"{expected.rover.value} {expected.period}"
    poses = record.during(record.poses, expected)
    if not poses:
        return Finding("rover", wanted, NEVER, False)
    away_m, turned_rad = _travel(poses)
    stands = away_m <= STILL_M and turned_rad <= STILL_RAD
    return Finding(
        "rover",
        wanted,
        f"went {away_m:.3f} m, turned {_angle(turned_rad)}",
        stands is (expected.rover is Movement.STANDS),
    )


def mode(expected: ModeIs, record: Record) -> Finding:
    """Compare the mode at a time."""
    wanted = f"{expected.mode.name} {expected.when}"
    seen = record.sample(record.modes, expected)
    if seen is None:
        return Finding("mode", wanted, NEVER, False)
    return Finding("mode", wanted, seen.mode.name, seen.mode is expected.mode)


def stands_while_held(record: Record) -> Finding:
    """Hold the rover to stand while it is STOPPED or SAFE."""
    worst_m = worst_rad = 0.0
    for held, seen in groupby(record.modes, key=lambda seen: seen.mode in HELD):
        if held:
            times = [each.time_s for each in seen]
            away_m, turned_rad = _travel(between(record.poses, times[0] + BRAKING_S, times[-1]))
            worst_m, worst_rad = max(worst_m, away_m), max(worst_rad, turned_rad)
    return Finding(
        "promise",
        "no motion while STOPPED or SAFE",
        f"went {worst_m:.3f} m, turned {_angle(worst_rad)}",
        worst_m <= STILL_M and worst_rad <= STILL_RAD,
    )


def _travel(poses: Sequence[TruePose]) -> tuple[float, float]:
    """Return how far from the first pose any other is, in metres and radians."""
    away_m = turned_rad = 0.0
    for seen in poses:
        first, other = poses[0].pose, seen.pose
        away_m = max(away_m, hypot(other.x_m - first.x_m, other.y_m - first.y_m))
        turned_rad = max(turned_rad, abs(wrap_rad(other.heading_rad - first.heading_rad)))
    return away_m, turned_rad


def _angle(angle_rad: float) -> str:
    return f"{degrees(angle_rad):.1f}°"


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


LEAST_CONTRAST: Final = 16
"""Between the darkest and the brightest pixel of a picture that shows something, of 255."""


def pictures(expected: Pictures, record: Record) -> Finding:
    """Look into the pictures that the rover has stored."""
    size = f"{expected.width_px or 'any'} × {expected.height_px or 'any'}"
    paths = sorted(record.files.glob("pictures/*.jpg"))
    faults = [
        f"{path.name} {fault}"
        for path in paths
        if (fault := _fault(path.read_bytes(), expected.width_px, expected.height_px))
    ]
    return Finding(
        "pictures",
        f"{expected.pictures} stored, {size} px, showing something",
        ", ".join([f"{len(paths)} stored", *faults]),
        len(paths) == expected.pictures and not faults,
    )


def video(expected: VideoComes, record: Record) -> Finding:
    """Look into the pictures that arrived in a while; where none is wanted, at every datagram."""
    wanted = f"at least {expected.video} pictures" if expected.video else "nothing arrives"
    wanted = f"{wanted} {expected.period}"
    if record.moment(expected) is None:
        return Finding("video", wanted, NEVER, False)
    arrived = record.during(record.video, expected)
    came = [each.picture for each in arrived if each.picture is not None]
    faults = [fault for picture in came if (fault := _fault(picture))]
    seen = f"{len(came)} pictures, {len(arrived)} datagrams"
    enough = len(came) >= expected.video if expected.video else not arrived
    return Finding("video", wanted, ", ".join([seen, *faults]), enough and not faults)


def _fault(octets: bytes, width_px: int | None = None, height_px: int | None = None) -> str:
    from PIL import Image

    try:
        with Image.open(BytesIO(octets), formats=["JPEG"]) as picture:
            size_px = picture.size
            darkest, brightest = picture.convert("L").getextrema()
    except OSError as error:
        return f"does not decode ({error})"
    if width_px not in (None, size_px[0]) or height_px not in (None, size_px[1]):
        return f"is {size_px[0]} × {size_px[1]} px"
    contrast = brightest - darkest  # type: ignore[operator]  # one band gives one pair
    return "is blank" if contrast < LEAST_CONTRAST else ""
