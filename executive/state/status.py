"""`Status`: the asset's state, from the facts of sensors; `Telemetry` sends it as parameters."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import cos, inf, isfinite, nan, sin
from typing import Final

from executive.obstacles.local_map import LocalMap
from executive.obstacles.zones import MAX_MARGIN_M, ScannedObstacle, Zones
from executive.settings import Settings
from executive.state.fusion import PoseFusion
from executive.state.navigation import NavigationTrack
from executive.state.slip import SlipCorrection
from executive.state.standstill import StandstillDetector, is_slow
from executive.state.uncertainty import Uncertainty
from executive.values.clock import Clock
from executive.values.facts import (
    Battery,
    CameraAngles,
    EmergencyStop,
    ExternalCommandRunning,
    Fact,
    ForeignPublishers,
    Frame,
    Imu,
    Joints,
    LaserScan,
    MapToOdom,
    MotionEnded,
    MotionStarted,
    NavigationFeedback,
    NavigationStatus,
    NavigationVelocity,
    Odometry,
    PlannedPath,
    RejectedData,
    SecondOdometry,
    Source,
)
from executive.values.geometry import STANDING, Point, Pose, Velocity
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity

ODOMETER_STEP_M: Final = 0.01
"""Minimum step that counts for the distance travelled: noise of odometry at rest does not count."""
MAX_PLANNED_PATHS: Final = 4
"""Number of answers of the navigation's planner that are stored: of a leg, and of previews."""
MAX_TRANSFORM_AGE_S: Final = 1.0
"""Maximum age of the map's transform, by arrival; localisations repeat it at 10 Hz and more."""
REJECTION_S: Final = 2.5
"""Timeout of a rejection; adapters repeat it each second."""


class Status:
    """The state of the asset; facts are stored only here. Ages count from arrival aboard.

    Args:
        correct: returns the odometry with the heading that the asset chooses; None: as it is.

    Attributes:
        travel_speed_mps, rotate_speed_radps, camera_speed_radps: the speed limits set now.
        speed_limit_ratio: factor of these speeds while a fault slows the rover down, else 1.
        compensation: offset of the measured pose, applied before use.
        odometry: the newest finite one, with the slip that it does not include itself.
        frame: the last camera frame; `frames` is its number.
        motion_started: the last whole motion that a rover of delegated motion started, and
            `motion_started_at_s`, the time of that report.
        motion_ended: the last whole motion that such a rover ended.
        executed_by_relay: the command that the rover last received over another link.
        navigation: the goal of the navigation; None without one below.
        map_to_odom: the newest pose of the odometry frame in the map; None without one.
        emergency_stop: whether the robot's own emergency stop is active.
        foreign_publishers: other publishers of the rover's velocity.
        standstill: detects standstill by each source.
        rejections: the sources with rejected data.
        fusion: corrects the pose by a second odometry; None without one.
        uncertainty: bounds of the error of `pose`.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        correct: Callable[[Odometry], Odometry] | None = None,
    ) -> None:
        self._clock = clock
        self._settings = settings
        self.travel_speed_mps = settings.drive.travel_speed_mps
        self.rotate_speed_radps = settings.drive.rotate_speed_radps
        self.camera_speed_radps = settings.camera.rotate_speed_radps
        self.speed_limit_ratio = 1.0
        self.compensation = Pose()
        self.odometry: Odometry | None = None
        self.battery: Battery | None = None
        self._battery_at_s = -inf
        self.camera: CameraAngles | None = None
        self.frame: Frame | None = None
        self.frames = 0
        self.motion_started: MotionStarted | None = None
        self.motion_started_at_s = -inf
        self.motion_ended: MotionEnded | None = None
        self._motion_ended_at_s = -inf
        self.executed_by_relay: Identity | None = None
        self.navigation = None if settings.navigation is None else NavigationTrack(clock)
        self.map_to_odom: Pose | None = None
        self._map_at_s = -inf
        self._raw = Pose()
        self._composed = (Pose(), Pose(), Pose())
        self._planned_paths: deque[PlannedPath] = deque(maxlen=MAX_PLANNED_PATHS)
        self.emergency_stop = False
        self.foreign_publishers: tuple[str, ...] = ()
        self.standstill = StandstillDetector(clock)
        self.rejections = Rejections(clock)
        second = settings.sensors.second_odometry
        self.fusion = None if second is None else PoseFusion(second.fused)
        mpc = settings.mpc
        self._slip = None
        if settings.offers_mpc and mpc.odometry_slip is not None:
            self._slip = SlipCorrection(mpc.slip, mpc.odometry_slip)
        self._local_map: LocalMap | None = None
        if settings.sensors.laser is not None and settings.footprint is not None:
            self._local_map = LocalMap(settings.footprint, settings.zones)
        self.uncertainty = Uncertainty()
        self._correct = correct
        self._obstacles = settings.zones
        self._obstacles_of: tuple[tuple[ScannedObstacle, ...], float] = ((), 0.0)
        self._odometry_at_s = -inf
        self._counted_m = 0.0
        self._counted_at: Point | None = None

    def observe(self, fact: Fact) -> None:
        """Update the state. Odometry or a voltage that is not finite counts as missing."""
        match fact:
            case Odometry():
                self._observe_odometry(fact)
            case Battery(voltage_v):
                valid = -inf < voltage_v <= self._settings.faults.battery_not_finite.bound
                self.battery = fact if valid else replace(fact, voltage_v=nan)
                self._battery_at_s = self._clock.now_s()
            case CameraAngles():
                self.camera = fact
            case Frame():
                self.frame = fact
                self.frames += 1
            case ForeignPublishers(names):
                self.foreign_publishers = names
            case MotionStarted():
                self.motion_started = fact
                self.motion_started_at_s = self._clock.now_s()
            case MotionEnded():
                self.motion_ended = fact
                self._motion_ended_at_s = self._clock.now_s()
            case ExternalCommandRunning(identity):
                self.executed_by_relay = identity
            case Imu() | Joints():
                self.standstill.observe(fact)
            case SecondOdometry():
                self.standstill.observe(fact)
                if self.fusion is not None:
                    self.fusion.add_second_odometry(fact)
            case LaserScan():
                if self._local_map is not None and self.odometry_fresh:
                    self._local_map.add_scan(fact, self._clock.now_s())
            case RejectedData():
                self.rejections.observe(fact)
            case EmergencyStop(active):
                self.emergency_stop = active
            case MapToOdom(pose):
                self.map_to_odom, self._map_at_s = pose, self._clock.now_s()
            case NavigationStatus() | NavigationFeedback() | NavigationVelocity():
                if self.navigation is not None:
                    self.navigation.observe(fact)
            case PlannedPath():
                self._planned_paths.append(fact)
            case _:
                pass  # independent of the asset's state

    @property
    def obstacles(self) -> Zones:
        """All obstacles now, known or scanned, in the frame of `pose`.

        The margin around them grows by the uncertainty of the position. The same object until a
        change.
        """
        circles = () if self._local_map is None else self._local_map.circles
        position_m = self.uncertainty.position_m
        if (circles, position_m) != self._obstacles_of:
            self._obstacles_of, zones = (circles, position_m), self._settings.zones
            margin_m = min(zones.margin_m + position_m, MAX_MARGIN_M)
            self._obstacles = replace(zones, rocks=(*zones.rocks, *circles), margin_m=margin_m)
        return self._obstacles

    def raise_uncertainty(self, position_m: float, heading_rad: float, cause: str) -> None:
        """Raise the uncertainty to these bounds; smaller ones change nothing."""
        known = self.uncertainty
        if position_m > known.position_m or heading_rad > known.heading_rad:
            by = known.confirmed_by if cause == known.cause else None
            position_m = max(position_m, known.position_m)
            heading_rad = max(heading_rad, known.heading_rad)
            self.uncertainty = Uncertainty(position_m, heading_rad, cause, by)

    def grow_uncertainty(self, position_m: float, heading_rad: float, cause: str) -> None:
        """Increase the uncertainty by these amounts."""
        known = self.uncertainty
        self.raise_uncertainty(
            known.position_m + position_m, known.heading_rad + heading_rad, cause
        )

    def clear_local_map(self) -> None:
        """Clear the local map: the pose changed without a motion."""
        if self._local_map is not None:
            self._local_map.clear()

    @property
    def travel_limit_mps(self) -> float:
        """The speed limit now."""
        return self.travel_speed_mps * self.speed_limit_ratio

    @property
    def rotate_limit_radps(self) -> float:
        """The yaw-rate limit now."""
        return self.rotate_speed_radps * self.speed_limit_ratio

    @property
    def pose(self) -> Pose:
        """The compensated pose of base_link; at the origin before the first odometry."""
        if self.odometry is None:
            return Pose()
        raw = self.odometry.pose if self.fusion is None else self.fusion.pose
        if self._composed[0] is not self.compensation or self._composed[1] is not raw:
            self._composed = self.compensation, raw, self.compensation.compose(raw)
        return self._composed[2]

    @property
    def pose_figures(self) -> tuple[Figure, ...]:
        """Figures of the pose, with its uncertainty and standard deviations if known."""
        pose, odometry = self.pose, self.odometry
        figures: tuple[Figure, ...] = (
            Figure("x", pose.x_m, "m"),
            Figure("y", pose.y_m, "m"),
            Figure("heading", pose.heading_rad, "rad"),
        )
        if self.uncertainty:
            figures = (*figures, *self.uncertainty.figures)
        if odometry is None or not odometry.position_sd_m:
            return figures
        return (
            *figures,
            Figure("position sd", odometry.position_sd_m, "m"),
            Figure("heading sd", odometry.heading_sd_rad, "rad"),
        )

    @property
    def map_age_s(self) -> float:
        """Seconds since the map's transform last arrived; infinite before the first."""
        return self._clock.now_s() - self._map_at_s

    @property
    def map_origin(self) -> Pose | Refusal:
        """The origin of the map in the frame of `pose` now, or a refusal if it is unknown."""
        age_s = self.map_age_s
        if self.map_to_odom is None or age_s > MAX_TRANSFORM_AGE_S:
            since = "yet" if self.map_to_odom is None else f"for {age_s:.2f} s"
            text = f"no transform from map to odom {since}: start the localisation, or use odom"
            bound = Figure("bound", MAX_TRANSFORM_AGE_S, "s")
            return Refusal(Reason.NO_MAP, text, (Figure("age", age_s, "s"), bound))
        return self.pose.compose(self.map_to_odom.compose(self._raw).inverse)

    @property
    def odom_origin(self) -> Pose:
        """The origin of the rover's odometry in the frame of `pose`."""
        return self.pose.compose(self._raw.inverse)

    def planned_path(self, number: int) -> PlannedPath | None:
        """Return the answer of the navigation's planner to a request; None without one."""
        return next((each for each in self._planned_paths if each.number == number), None)

    def turn_slide(self, turn_rad: float) -> Point:
        """Return the expected slide of a turn on the spot here, in the frame of `pose`."""
        if self.fusion is None:
            return Point(0.0, 0.0)
        slid, heading_rad = self.fusion.turn_slide(turn_rad), self.compensation.heading_rad
        return Point(
            slid.x_m * cos(heading_rad) - slid.y_m * sin(heading_rad),
            slid.x_m * sin(heading_rad) + slid.y_m * cos(heading_rad),
        )

    @property
    def travelled_m(self) -> float:
        """Length of the path of base_link since the start, by odometry."""
        if self.odometry is None or self._counted_at is None:
            return 0.0
        return self._counted_m + self._counted_at.distance_m(self.odometry.pose.point)

    @property
    def velocity(self) -> Velocity:
        """The measured velocity of base_link; zero before the first odometry."""
        return STANDING if self.odometry is None else self.odometry.velocity

    @property
    def odometry_age_s(self) -> float:
        """Seconds since odometry last arrived; infinite before the first."""
        return self._clock.now_s() - self._odometry_at_s

    @property
    def odometry_fresh(self) -> bool:
        """Whether odometry is recent enough to move."""
        return self.odometry_age_s <= self._settings.faults.odometry_stale.bound

    @property
    def standing(self) -> bool:
        """Whether the twist of fresh odometry shows standstill, which suffices to continue.

        `standstill` checks all sources over a window.
        """
        if self.odometry is None or not self.odometry_fresh:
            return False
        return is_slow(self.odometry.velocity)

    @property
    def stationary_since_motion(self) -> bool:
        """Whether odometry received since the end of the last whole motion shows standstill."""
        return self.standing and self._odometry_at_s >= self._motion_ended_at_s

    def values(self) -> tuple[ParameterValue, ...]:
        """Return all twelve parameters, in the order of their definition.

        Values from stale odometry or a stale voltage are unknown.
        """
        figures: dict[Parameter, float] = {
            Parameter.TRAVEL_SPEED: self.travel_speed_mps,
            Parameter.ROTATE_SPEED: self.rotate_speed_radps,
            Parameter.CAM_ROTATE_SPEED: self.camera_speed_radps,
        }
        if self.odometry is not None and self.odometry_fresh:
            pose, velocity = self.pose, self.odometry.velocity
            figures |= {
                Parameter.POS_X: pose.x_m,
                Parameter.POS_Y: pose.y_m,
                Parameter.POS_Z: pose.z_m,
                Parameter.HEAD: pose.heading_rad,
                Parameter.CURRENT_TRAVEL_SPEED: velocity.travel_mps,
                Parameter.CURRENT_ROTATE_SPEED: velocity.rotate_radps,
            }
        battery_age_s = self._clock.now_s() - self._battery_at_s
        voltage_v = nan if self.battery is None else self.battery.voltage_v
        if isfinite(voltage_v) and battery_age_s <= self._settings.faults.battery_silent.bound:
            figures[Parameter.BATERY_VOLTAGE] = voltage_v
        if self.camera is not None:
            figures[Parameter.CAM_PAN] = self.camera.pan_rad
            figures[Parameter.CAM_TILT] = self.camera.tilt_rad
        now = self._clock.utc_s()
        return tuple(ParameterValue(name, now, figures.get(name)) for name in Parameter)

    def _observe_odometry(self, fact: Odometry) -> None:
        if not (fact.pose.finite and fact.velocity.finite):
            return
        self._raw = fact.pose
        if self._correct is not None:
            fact = self._correct(fact)
        if self._slip is not None:
            fact = self._slip.corrected(fact)
        if not self.odometry_fresh:
            self.clear_local_map()
        step_m, explained_m = 0.0, 0.0
        if (last := self.odometry) is not None:
            step_m = last.pose.point.distance_m(fact.pose.point)
            speeds_mps = abs(last.velocity.travel_mps), abs(fact.velocity.travel_mps)
            explained_m = self._settings.faults.odometry_jumped.bound
            explained_m += self.odometry_age_s * max(speeds_mps)
        self.odometry = fact
        point = fact.pose.point
        if self._counted_at is None or step_m > explained_m:
            self._counted_at = point
        elif (distance_m := self._counted_at.distance_m(point)) >= ODOMETER_STEP_M:
            self._counted_m += distance_m
            self._counted_at = point
        self._odometry_at_s = self._clock.now_s()
        self.standstill.observe(fact)
        if self.fusion is not None:
            self.fusion.add_odometry(fact)
        if self._local_map is not None:
            self._local_map.add_pose(fact.stamp_s, self.pose, fact.velocity)


class Rejections:
    """The last rejection of each source."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._until_s: dict[Source, tuple[RejectedData, float]] = {}

    def observe(self, fact: RejectedData) -> None:
        """Record the rejection that an adapter reports."""
        self._until_s[fact.source] = fact, self._clock.now_s() + REJECTION_S

    def of(self, source: Source | None) -> RejectedData | None:
        """Return the present rejection of a source, or None."""
        found = self._until_s.get(source) if self._until_s and source else None
        return found[0] if found and self._clock.now_s() <= found[1] else None

    def explain(self, text: str, source: Source | None) -> str:
        """Return a text on missing data, followed by why data of its source are rejected."""
        found = self.of(source)
        return f"{text}; {found}" if found else text


class Telemetry:
    """Sends the status (thesis 5.1.3, status interval), first immediately.

    Attributes:
        interval_s: seconds between two transmissions of all values; 0 sends changed values only.
    """

    def __init__(
        self,
        clock: Clock,
        sample: Callable[[], Sequence[ParameterValue]],
        send: Callable[[Sequence[ParameterValue]], None],
        interval_s: float,
    ) -> None:
        self._clock = clock
        self._sample = sample
        self._send = send
        self.interval_s = interval_s
        self._next_s = clock.now_s()
        self._sent: dict[Parameter, float | None] = {}

    def set_interval(self, interval_s: float) -> None:
        """Change the interval, and send immediately."""
        self.interval_s = interval_s
        self._next_s = self._clock.now_s()
        self._sent.clear()

    def update(self) -> None:
        """Send the values that are due. Called once a tick."""
        now_s = self._clock.now_s()
        if self.interval_s > 0.0:
            if now_s < self._next_s:
                return
            self._next_s = max(self._next_s + self.interval_s, now_s)
            due = self._sample()
        else:
            due = tuple(
                value
                for value in self._sample()
                if value.parameter not in self._sent or self._sent[value.parameter] != value.value
            )
            self._sent.update({value.parameter: value.value for value in due})
        if due:
            self._send(due)
