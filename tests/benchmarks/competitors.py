"""Controllers that `rover bench locomotion` measures beside those of the product.

To enter one: a class with the method of `Competitor`, and its name in `COMPETITORS`. It steers the
control point, the point ahead of base_link that stands still when the rover spins, and gets
what the product's controllers get: odometry, and velocities limited in speed and acceleration.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import copysign, cos, hypot, pi, sin, sqrt
from typing import TYPE_CHECKING, Final, Protocol

from executive.settings import Controller, SpeedProfileKind
from executive.values.geometry import Pose, Velocity, arc_end, wrap_rad

if TYPE_CHECKING:
    from tests.benchmarks.mppi import Mppi


@dataclass(frozen=True, slots=True)
class Task:
    """What is asked of a competitor: to stand at a pose, from rest at another.

    Attributes:
        goal: where the control point is to stand, and at which heading.
        travel_speed_mps, rotate_speed_radps: greatest speeds, as the accelerations below.
        tick_s: how often it is asked for a velocity.
        latency_s: from a command until odometry shows it.
        within_m, within_rad: how near is near enough.
    """

    goal: Pose
    travel_speed_mps: float
    rotate_speed_radps: float
    travel_acceleration_mps2: float
    rotate_acceleration_radps2: float
    tick_s: float
    latency_s: float
    within_m: float
    within_rad: float


@dataclass(frozen=True, slots=True)
class Seen:
    """What is known in a tick.

    Attributes:
        pose: of the control point, by odometry.
        velocity: by odometry.
        sent: what was commanded last, within the limits.
    """

    pose: Pose
    velocity: Velocity
    sent: Velocity

    def soon(self, after_s: float) -> Pose:
        """Return the pose after so many seconds with what was commanded last."""
        return arc_end(self.pose, self.sent.travel_mps * after_s, self.sent.rotate_radps * after_s)


class Competitor(Protocol):
    """Drives to one pose; a new one is made for each."""

    def command(self, seen: Seen) -> Velocity:
        """Return the velocity to command in this tick; the limits are applied to it."""


AIM: Final = 0.5
"""Of the tolerances: within which the competitors here are content."""


class _Turning:
    """What the laws that turn, drive and turn have in common: how they stand at the end."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._near_m, self._near_rad = AIM * task.within_m, AIM * task.within_rad

    def _left(self, pose: Pose) -> tuple[float, float, float]:
        """Return the distance to the goal, the turn towards it, and the turn to its heading."""
        goal = self._task.goal
        toward_rad = pose.point.bearing_rad(goal.point)
        turn_rad = wrap_rad(toward_rad - pose.heading_rad)
        last_rad = wrap_rad(goal.heading_rad - pose.heading_rad)
        return pose.point.distance_m(goal.point), turn_rad, last_rad


TURN_PER_S: Final = 2.0
DRIVE_PER_S: Final = 1.0


class Proportional(_Turning):
    """Turns towards the goal, drives there, turns to its heading; each in proportion to the rest.

    After the controller of the thesis (5.1.3); gains by hand.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._turned = self._arrived = False

    def command(self, seen: Seen) -> Velocity:
        """Return what is in proportion to the first of turn, way and turn that is left."""
        left_m, turn_rad, last_rad = self._left(seen.pose)
        self._arrived = left_m <= (self._task.within_m if self._arrived else self._near_m)
        if self._arrived:
            self._turned = False
            return Velocity(0.0, TURN_PER_S * last_rad if abs(last_rad) > self._near_rad else 0.0)
        self._turned = self._turned or abs(turn_rad) <= self._near_rad
        if not self._turned:
            return Velocity(0.0, TURN_PER_S * turn_rad)
        self._turned = abs(turn_rad) < pi / 2
        return Velocity(DRIVE_PER_S * left_m, TURN_PER_S * turn_rad if left_m > 0.1 else 0.0)


LOOKAHEAD_S: Final = 0.8
LOOKAHEAD_MIN_M, LOOKAHEAD_MAX_M = 0.3, 0.9
TURN_FIRST_RAD: Final = pi / 4
REGULATED_RADIUS_M: Final = 0.5
BRAKE_SHARE: Final = 0.8
"""Of the greatest deceleration, by which it brakes before the goal."""


class PurePursuit(_Turning):
    """Regulated pure pursuit of the straight line to the goal, then a turn to its heading.

    Steers to a point of the line ahead, along an arc (Coulter 1992), slower where that is tight and
    near the goal (Macenski et al. 2023); where the point is far aside, it turns on the spot first.
    """

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        self._start: Pose | None = None
        self._arrived = False

    def command(self, seen: Seen) -> Velocity:
        """Return the velocity along the arc to the point ahead."""
        task, pose = self._task, seen.soon(self._task.latency_s)
        self._start = self._start or seen.pose
        left_m, turn_rad, last_rad = self._left(pose)
        self._arrived = left_m <= (task.within_m if self._arrived else self._near_m)
        if self._arrived:
            return Velocity(0.0, self._turn(last_rad) if abs(last_rad) > self._near_rad else 0.0)
        reach_m = LOOKAHEAD_S * abs(seen.velocity.travel_mps)
        reach_m = min(max(reach_m, LOOKAHEAD_MIN_M), LOOKAHEAD_MAX_M)
        ahead_m, aside_m = self._carrot(pose, reach_m)
        apart_m = hypot(ahead_m, aside_m)
        if ahead_m <= 0.0 or abs(aside_m) > apart_m * sin(TURN_FIRST_RAD):
            return Velocity(0.0, self._turn(turn_rad))
        bend_per_m = 2.0 * aside_m / apart_m**2
        speed_mps = min(task.travel_speed_mps, self._brake_to(left_m))
        if bend_per_m:
            speed_mps *= min(1.0, 1.0 / (abs(bend_per_m) * REGULATED_RADIUS_M))
            speed_mps = min(speed_mps, task.rotate_speed_radps / abs(bend_per_m))
        return Velocity(speed_mps, speed_mps * bend_per_m)

    def _carrot(self, pose: Pose, reach_m: float) -> tuple[float, float]:
        """Return the point of the line so far ahead, as how far it is ahead and to the left."""
        start, goal = self._start or pose, self._task.goal
        whole_m = max(start.point.distance_m(goal.point), 1e-6)
        along_x, along_y = (goal.x_m - start.x_m) / whole_m, (goal.y_m - start.y_m) / whole_m
        passed_m = (pose.x_m - start.x_m) * along_x + (pose.y_m - start.y_m) * along_y
        at_m = min(passed_m + reach_m, whole_m)
        x_m = start.x_m + at_m * along_x - pose.x_m
        y_m = start.y_m + at_m * along_y - pose.y_m
        cosine, sine = cos(pose.heading_rad), sin(pose.heading_rad)
        return x_m * cosine + y_m * sine, y_m * cosine - x_m * sine

    def _brake_to(self, left_m: float) -> float:
        return sqrt(2.0 * BRAKE_SHARE * self._task.travel_acceleration_mps2 * left_m)

    def _turn(self, left_rad: float) -> float:
        braking = BRAKE_SHARE * self._task.rotate_acceleration_radps2
        return copysign(min(sqrt(2.0 * braking * abs(left_rad)), 5.0 * abs(left_rad)), left_rad)


def _mppi(task: Task) -> "Mppi":
    from tests.benchmarks.mppi import Mppi

    return Mppi(task)


COMPETITORS: Final[dict[str, Callable[[Task], Competitor]]] = {
    "proportional": Proportional,
    "pure-pursuit": PurePursuit,
    "mppi": _mppi,
}
"""Those that are measured, by the name that `--controller` takes."""


@dataclass(frozen=True, slots=True)
class Own:
    """A controller of the product: it drives within the executive, as a command makes it.

    Attributes:
        true_cm: goal of the true error, p95; the side slip of fast curves is not in the odometry.
    """

    choice: Controller
    profile: SpeedProfileKind
    true_cm: float


OWN: Final = {
    "turn-drive": Own(Controller.TURN_DRIVE, SpeedProfileKind.SQUARE_ROOT, 2.0),
    "turn-drive-trapezoid": Own(Controller.TURN_DRIVE, SpeedProfileKind.TRAPEZOID, 2.0),
    "mpc": Own(Controller.MPC, SpeedProfileKind.SQUARE_ROOT, 6.0),
}
"""Controllers of the product, by the name that `--controller` takes."""
