"""What can be expected of the rover, and what came of it: pose, mode, telemetry, pictures.

Each kind of expectation is a dataclass, told apart in the file by its first key.
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
    ReceivedValue,
    Record,
    Scheduled,
    ScheduledInterval,
    TruePose,
)

SHORTEST_S: Final = 0.001
"""A while that is needed lasts at least so long."""
STILL_M: Final = 0.02
STILL_RAD: Final = radians(2.0)
"""A rover stands that stays within these of where it was."""
LEAST_CONTRAST: Final = 16
"""Between the darkest and the brightest pixel of a picture that shows something, of 255."""


@dataclass(frozen=True, slots=True)
class WorldPose:
    """Where base_link is, in the frame of the world; the heading may be left open."""

    x_m: float
    y_m: float
    heading_rad: float | None = None


@unique
class Movement(Enum):
    """Whether the rover goes anywhere."""

    STANDS = "stands"
    MOVES = "moves"


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseIs(Scheduled):
    """Where the rover truly is.

    Attributes:
        tolerance_m: greatest distance from the place.
        heading_tolerance_rad: greatest angle from the heading.
    """

    pose: WorldPose
    tolerance_m: float = figure()
    heading_tolerance_rad: float = figure(default=0.05)

    def judge(self, record: Record) -> Check:
        """Compare the true pose at a time."""
        place = self.pose
        wanted = f"x {place.x_m:.2f} y {place.y_m:.2f} ± {self.tolerance_m:g} m"
        if place.heading_rad is not None:
            wanted += f", {_angle(place.heading_rad)} ± {_angle(self.heading_tolerance_rad)}"
        wanted += f" {self.when}"
        seen = record.sample(record.poses, self)
        if seen is None:
            return Check("true pose", wanted, NEVER, False)
        true = seen.pose
        away_m = hypot(true.x_m - place.x_m, true.y_m - place.y_m)
        found = f"x {true.x_m:.3f} y {true.y_m:.3f}, {away_m:.3f} m off"
        holds = away_m <= self.tolerance_m
        if place.heading_rad is not None:
            off_rad = abs(wrap_rad(true.heading_rad - place.heading_rad))
            found += f", {_angle(true.heading_rad)}, {_angle(off_rad)} off"
            holds = holds and off_rad <= self.heading_tolerance_rad
        return Check("true pose", wanted, found, holds)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeIs(Scheduled):
    """The asset's mode."""

    mode: Mode

    def judge(self, record: Record) -> Check:
        """Compare the mode at a time."""
        wanted = f"{self.mode.name} {self.when}"
        seen = record.sample(record.modes, self)
        if seen is None:
            return Check("mode", wanted, NEVER, False)
        return Check("mode", wanted, seen.mode.name, seen.mode is self.mode)


@dataclass(frozen=True, slots=True, kw_only=True)
class RoverMoves(ScheduledInterval):
    """Whether the rover truly stands throughout a while, or moves within it."""

    rover: Movement
    for_s: float = figure(SHORTEST_S)

    def judge(self, record: Record) -> Check:
        """Look whether the rover moves in a while."""
        wanted = f"{self.rover.value} {self.period}"
        poses = record.during(record.poses, self)
        if not poses:
            return Check("rover", wanted, NEVER, False)
        away_m, turned_rad = travel(poses)
        stands = away_m <= STILL_M and turned_rad <= STILL_RAD
        return Check(
            "rover",
            wanted,
            f"went {away_m:.3f} m, turned {_angle(turned_rad)}",
            stands is (self.rover is Movement.STANDS),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterIs(ScheduledInterval):
    """What a telemetry parameter says: the first value after the time, or all in a while.

    Attributes:
        once: one value of the while is enough.
        asked: the label of a question; its answer is looked at instead of telemetry.
    """

    parameter: Parameter
    value: float = angle()
    tolerance: float = angle(0.0, default=0.0)
    once: bool = False
    asked: str | None = None

    def __post_init__(self) -> None:
        ScheduledInterval.__post_init__(self)
        if self.once and not self.for_s:
            raise ValueError("once needs for: one value of which while?")

    def judge(self, record: Record) -> Check:
        """Compare the values of a parameter in telemetry, or in the answer to a question."""
        unit = self.parameter.unit
        when = self.period if self.asked is None else f"asked by {self.asked}"
        subject = self.parameter.value
        once = ", once" if self.once else ""
        wanted = f"{self.value:.4g} ± {self.tolerance:.4g} {unit} {when}{once}"
        seen = [each.value for each in self._looked_at(record)]
        if not seen:
            return Check(subject, wanted, "no value came", False)
        known = [value for value in seen if value is not None]
        if len(known) < len(seen):
            return Check(subject, wanted, "not known aboard", False)
        judged = (min if self.once else max)(known, key=self._distance)
        which = "nearest" if self.once else "worst"
        count = f", the {which} of {len(known)}" if len(known) > 1 else ""
        holds = self._distance(judged) <= self.tolerance
        return Check(subject, wanted, f"{judged:.4g} {unit}{count}", holds)

    def _looked_at(self, record: Record) -> Sequence[ReceivedValue]:
        wanted = self.parameter
        if self.asked is not None:
            answers = [asked.values for asked in record.answers if asked.label == self.asked]
            return [value for values in answers for value in values if value.parameter is wanted]
        heard = [value for value in record.values if value.parameter is wanted]
        if self.for_s:
            return record.during(heard, self)
        first = record.sample(heard, self)
        return [] if first is None else [first]

    def _distance(self, value: float) -> float:
        difference = value - self.value
        return abs(wrap_rad(difference) if self.parameter is Parameter.HEAD else difference)


@dataclass(frozen=True, slots=True, kw_only=True)
class TelemetryCount(ScheduledInterval):
    """How often each of the twelve parameters arrives in a while."""

    telemetry: int = figure()
    tolerance: int = figure(default=0)

    def judge(self, record: Record) -> Check:
        """Count how often each parameter arrived in a while."""
        wanted = f"{self.telemetry} ± {self.tolerance} × each parameter {self.period}"
        if record.moment(self) is None:
            return Check("telemetry", wanted, NEVER, False)
        heard = Counter(value.parameter for value in record.during(record.values, self))
        counts = sorted(heard[each] for each in Parameter)
        return Check(
            "telemetry",
            wanted,
            f"{counts[0]} to {counts[-1]} ×" if counts[0] < counts[-1] else f"{counts[0]} ×",
            all(abs(count - self.telemetry) <= self.tolerance for count in counts),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureCount:
    """Pictures that the rover has stored by the end: JPEG files that decode and show something.

    Attributes:
        width_px, height_px: the size of each; None for any.
    """

    pictures: int = figure()
    width_px: int | None = None
    height_px: int | None = None

    def judge(self, record: Record) -> Check:
        """Look into the pictures that the rover has stored."""
        size = f"{self.width_px or 'any'} × {self.height_px or 'any'}"
        paths = sorted(record.files.glob("pictures/*.jpg"))
        faults = [
            f"{path.name} {fault}"
            for path in paths
            if (fault := _fault(path.read_bytes(), self.width_px, self.height_px))
        ]
        return Check(
            "pictures",
            f"{self.pictures} stored, {size} px, showing something",
            ", ".join([f"{len(paths)} stored", *faults]),
            len(paths) == self.pictures and not faults,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class VideoComes(ScheduledInterval):
    """Pictures of the video stream that arrive on the ground while it lasts; with --live only.

    Attributes:
        video: how many whole ones at least, each showing something; 0 for no datagram at all.
    """

    video: int = figure()
    for_s: float = figure(SHORTEST_S)

    def judge(self, record: Record) -> Check:
        """Look into the pictures that arrived; where none is wanted, at every datagram."""
        wanted = f"at least {self.video} pictures" if self.video else "nothing arrives"
        wanted = f"{wanted} {self.period}"
        if record.moment(self) is None:
            return Check("video", wanted, NEVER, False)
        arrived = record.during(record.video, self)
        came = [each.picture for each in arrived if each.picture is not None]
        faults = [fault for picture in came if (fault := _fault(picture))]
        seen = f"{len(came)} pictures, {len(arrived)} datagrams"
        enough = len(came) >= self.video if self.video else not arrived
        return Check("video", wanted, ", ".join([seen, *faults]), enough and not faults)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contacts:
    """How often the rover has begun to touch a rock, a wall or a step; in lock step only."""

    contacts: int = figure()

    def judge(self, record: Record) -> Check:
        """Compare the contacts of the whole run."""
        seen = record.contacts
        text = "not known" if seen is None else f"{seen} contacts"
        return Check("contacts", f"{self.contacts} contacts", text, seen == self.contacts)


RoverExpectation = (
    PoseIs
    | ModeIs
    | RoverMoves
    | ParameterIs
    | TelemetryCount
    | PictureCount
    | VideoComes
    | Contacts
)


def travel(poses: Sequence[TruePose]) -> tuple[float, float]:
    """Return how far from the first pose any other is, in metres and radians."""
    away_m = turned_rad = 0.0
    for seen in poses:
        first, other = poses[0].pose, seen.pose
        away_m = max(away_m, hypot(other.x_m - first.x_m, other.y_m - first.y_m))
        turned_rad = max(turned_rad, abs(wrap_rad(other.heading_rad - first.heading_rad)))
    return away_m, turned_rad


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


def _angle(angle_rad: float) -> str:
    return f"{degrees(angle_rad):.1f}°"
