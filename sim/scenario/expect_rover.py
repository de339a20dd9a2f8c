"""Expectations of scenarios on the rover: pose, mode, telemetry, pictures; their evaluation.

Each kind of expectation is a dataclass; its first key identifies it in the file.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, unique
from io import BytesIO
from math import degrees, hypot, radians
from typing import Final

from executive.commands import Mode
from executive.settings import angle, figure
from executive.values.geometry import wrap_rad
from executive.values.parameters import Parameter
from sim.scenario.record import (
    NEVER,
    Check,
    Record,
    Scheduled,
    ScheduledInterval,
    TruePose,
    ValueSample,
)

MIN_INTERVAL_S: Final = 0.001
"""Minimum length of a required interval."""
STILL_M: Final = 0.02
STILL_RAD: Final = radians(2.0)
"""Maximum displacement of a stationary rover from its first pose; chosen, not measured."""
MIN_CONTRAST: Final = 16
"""Minimum difference of the brightest and darkest pixel, of 255; below it a picture is blank."""


@dataclass(frozen=True, slots=True)
class WorldPose:
    """Pose of base_link in the world frame; the heading is optional."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


@unique
class Movement(Enum):
    """Motion state of the rover."""

    STATIONARY = "stationary"
    MOVING = "moving"


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseIs(Scheduled):
    """Expected true pose of the rover.

    Attributes:
        tolerance_m: maximum distance from the position.
        heading_tolerance_rad: maximum angle from the heading.
    """

    pose: WorldPose
    tolerance_m: float = figure()
    heading_tolerance_rad: float = figure(default=0.05)

    def judge(self, record: Record) -> Check:
        """Compare the true pose at a time with the expected one."""
        target = self.pose
        wanted = f"x {target.x_m:.2f} y {target.y_m:.2f} ± {self.tolerance_m:g} m"
        if target.heading_rad is not None:
            wanted += f", {_angle(target.heading_rad)} ± {_angle(self.heading_tolerance_rad)}"
        wanted += f" {self.time_text}"
        seen = record.sample(record.poses, self)
        if seen is None:
            return Check("true pose", wanted, NEVER, False)
        true = seen.pose
        away_m = hypot(true.x_m - target.x_m, true.y_m - target.y_m)
        found = f"x {true.x_m:.3f} y {true.y_m:.3f}, {away_m:.3f} m off"
        holds = away_m <= self.tolerance_m
        if target.heading_rad is not None:
            off_rad = abs(wrap_rad(true.heading_rad - target.heading_rad))
            found += f", {_angle(true.heading_rad)}, {_angle(off_rad)} off"
            holds = holds and off_rad <= self.heading_tolerance_rad
        return Check("true pose", wanted, found, holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeIs(Scheduled):
    """Expected mode of the asset."""

    mode: Mode

    def judge(self, record: Record) -> Check:
        """Compare the mode at a time with the expected one."""
        wanted = f"{self.mode.name} {self.time_text}"
        seen = record.sample(record.modes, self)
        if seen is None:
            return Check("mode", wanted, NEVER, False)
        return Check("mode", wanted, seen.mode.name, seen.mode is self.mode)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverMoves(ScheduledInterval):
    """Expected motion state: truly stationary throughout an interval, or moving within it."""

    rover: Movement
    for_s: float = figure(MIN_INTERVAL_S)

    def judge(self, record: Record) -> Check:
        """Compare the true motion in the interval with the expected state."""
        wanted = f"{self.rover.value} {self.interval_text}"
        poses = record.during(record.poses, self)
        if not poses:
            return Check("rover", wanted, NEVER, False)
        away_m, turned_rad = travel(poses)
        is_stationary = away_m <= STILL_M and turned_rad <= STILL_RAD
        return Check(
            "rover",
            wanted,
            f"went {away_m:.3f} m, turned {_angle(turned_rad)}",
            is_stationary is (self.rover is Movement.STATIONARY),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterIs(ScheduledInterval):
    """Expected value of a parameter: the first after a time, or all in an interval.

    Attributes:
        once: one value of the interval is enough.
        query: label of a query; its answer is evaluated instead of telemetry.
    """

    parameter: Parameter
    value: float = angle()
    tolerance: float = angle(0.0, default=0.0)
    once: bool = False
    query: str | None = None

    def __post_init__(self) -> None:
        ScheduledInterval.__post_init__(self)
        if self.once and not self.for_s:
            raise ValueError("once needs for: the interval of the values")

    def judge(self, record: Record) -> Check:
        """Compare the values in telemetry, or in the answer to a query, with the expected one."""
        unit = self.parameter.unit
        when = self.interval_text if self.query is None else f"query {self.query}"
        subject = self.parameter.value
        once = ", once" if self.once else ""
        wanted = f"{self.value:.4g} ± {self.tolerance:.4g} {unit} {when}{once}"
        seen = [each.value for each in self._samples(record)]
        if not seen:
            return Check(subject, wanted, "no value received", False)
        known = [value for value in seen if value is not None]
        if len(known) < len(seen):
            return Check(subject, wanted, "unknown aboard", False)
        judged = (min if self.once else max)(known, key=self._distance)
        which = "nearest" if self.once else "worst"
        count = f", the {which} of {len(known)}" if len(known) > 1 else ""
        holds = self._distance(judged) <= self.tolerance
        return Check(subject, wanted, f"{judged:.4g} {unit}{count}", holds)

    def _samples(self, record: Record) -> Sequence[ValueSample]:
        wanted = self.parameter
        if self.query is not None:
            answers = [answer.values for answer in record.answers if answer.label == self.query]
            return [value for values in answers for value in values if value.parameter is wanted]
        received = [value for value in record.values if value.parameter is wanted]
        if self.for_s:
            return record.during(received, self)
        first = record.sample(received, self)
        return [] if first is None else [first]

    def _distance(self, value: float) -> float:
        difference = value - self.value
        return abs(wrap_rad(difference) if self.parameter is Parameter.HEAD else difference)


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryCount(ScheduledInterval):
    """Expected number of values of each of the twelve parameters in an interval."""

    telemetry: int = figure()
    tolerance: int = figure(default=0)

    def judge(self, record: Record) -> Check:
        """Compare the number of values of each parameter with the expected one."""
        wanted = f"{self.telemetry} ± {self.tolerance} × each parameter {self.interval_text}"
        if record.resolve_time(self) is None:
            return Check("telemetry", wanted, NEVER, False)
        received = Counter(value.parameter for value in record.during(record.values, self))
        counts = sorted(received[each] for each in Parameter)
        return Check(
            "telemetry",
            wanted,
            f"{counts[0]} to {counts[-1]} ×" if counts[0] < counts[-1] else f"{counts[0]} ×",
            all(abs(count - self.telemetry) <= self.tolerance for count in counts),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureCount:
    """Expected number of pictures stored at the end: JPEG files that decode and are not blank.

    Attributes:
        width_px, height_px: the size of each; None for any.
    """

    pictures: int = figure()
    width_px: int | None = None
    height_px: int | None = None

    def judge(self, record: Record) -> Check:
        """Check the pictures that the rover has stored."""
        size = f"{self.width_px or 'any'} × {self.height_px or 'any'}"
        paths = sorted(record.files.glob("pictures/*.jpg"))
        faults = [
            f"{path.name} {fault}"
            for path in paths
            if (fault := _picture_error(path.read_bytes(), self.width_px, self.height_px))
        ]
        return Check(
            "pictures",
            f"{self.pictures} stored, {size} px, not blank",
            ", ".join([f"{len(paths)} stored", *faults]),
            len(paths) == self.pictures and not faults,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoExpectation(ScheduledInterval):
    """Expected pictures of the video stream received in an interval; with --live only.

    Attributes:
        video: minimum number of complete, non-blank pictures; 0 expects no datagram.
    """

    video: int = figure()
    for_s: float = figure(MIN_INTERVAL_S)

    def judge(self, record: Record) -> Check:
        """Check the received pictures; if none is expected, that no datagram was received."""
        wanted = f"at least {self.video} pictures" if self.video else "no datagram"
        wanted = f"{wanted} {self.interval_text}"
        if record.resolve_time(self) is None:
            return Check("video", wanted, NEVER, False)
        arrived = record.during(record.video, self)
        pictures = [each.picture for each in arrived if each.picture is not None]
        faults = [fault for picture in pictures if (fault := _picture_error(picture))]
        seen = f"{len(pictures)} pictures, {len(arrived)} datagrams"
        enough = len(pictures) >= self.video if self.video else not arrived
        return Check("video", wanted, ", ".join([seen, *faults]), enough and not faults)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contacts:
    """Expected number of new contacts with a rock, a wall or a step; in lock step only."""

    contacts: int = figure()

    def judge(self, record: Record) -> Check:
        """Compare the number of contacts of the whole run with the expected one."""
        seen = record.contacts
        text = "unknown" if seen is None else f"{seen} contacts"
        return Check("contacts", f"{self.contacts} contacts", text, seen == self.contacts)


RoverExpectation = (
    PoseIs
    | ModeIs
    | RoverMoves
    | ParameterIs
    | TelemetryCount
    | PictureCount
    | VideoExpectation
    | Contacts
)


def travel(poses: Sequence[TruePose]) -> tuple[float, float]:
    """Return the maximum distance and turn from the first pose, in m and rad."""
    away_m = turned_rad = 0.0
    for seen in poses:
        first, other = poses[0].pose, seen.pose
        away_m = max(away_m, hypot(other.x_m - first.x_m, other.y_m - first.y_m))
        turned_rad = max(turned_rad, abs(wrap_rad(other.heading_rad - first.heading_rad)))
    return away_m, turned_rad


def _picture_error(octets: bytes, width_px: int | None = None, height_px: int | None = None) -> str:
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
    return "is blank" if contrast < MIN_CONTRAST else ""


def _angle(angle_rad: float) -> str:
    return f"{degrees(angle_rad):.1f}°"
