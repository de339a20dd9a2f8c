"""The state of the asset that follows from the facts that sensors report."""

from math import cos, hypot, inf, isfinite, sin

from executive.clock import Clock
from executive.geometry import STANDING, Pose, Velocity, wrap_rad
from executive.reasons import Figure, Reason, Refusal
from executive.reports import Identity
from executive.settings import Settings
from executive.state.facts import (
    AuthorityUsed,
    Battery,
    CameraAngles,
    CommandEnded,
    CommandUnderWay,
    Fact,
    ForeignPublishers,
    Frame,
    Imu,
    Joints,
    LaserScan,
    MotionEnded,
    Odometry,
    SecondOdometry,
    Stopped,
)
from executive.state.telemetry import Parameter, ParameterValue

STANDING_TRAVEL_MPS = 0.03
STANDING_ROTATE_RADPS = 0.06


class Status:
    """The one place where facts are kept. Ages are counted from arrival aboard.

    Attributes:
        travel_speed_mps, rotate_speed_radps, camera_speed_radps: the greatest speeds now set.
        compensation: what is added to the measured pose before it is used.
        jump: the last odometry step that no motion of the rover explains, until a resume.
        frame: the last camera frame, with its number in `frames`.
        motion_ended: the last whole motion that the rover ended, where it moves by itself.
        elsewhere: the command that the rover last received over another link.
        foreign: other publishers of the rover's velocity.
    """

    def __init__(self, clock: Clock, settings: Settings) -> None:
        self._clock = clock
        self._settings = settings
        self.travel_speed_mps = settings.drive.travel_speed_mps
        self.rotate_speed_radps = settings.drive.rotate_speed_radps
        self.camera_speed_radps = settings.camera.rotate_speed_radps
        self.compensation = Pose()
        self.odometry: Odometry | None = None
        self.battery: Battery | None = None
        self.camera: CameraAngles | None = None
        self.frame: Frame | None = None
        self.frames = 0
        self.motion_ended: MotionEnded | None = None
        self.elsewhere: Identity | None = None
        self.foreign: tuple[str, ...] = ()
        self.jump: Refusal | None = None
        self._odometry_at_s = -inf

    def observe(self, fact: Fact) -> None:
        """Take in a fact. Odometry or a voltage that is not finite counts as missing."""
        match fact:
            case Odometry():
                self._observe_odometry(fact)
            case Battery(voltage_v):
                if isfinite(voltage_v):
                    self.battery = fact
            case CameraAngles():
                self.camera = fact
            case Frame():
                self.frame = fact
                self.frames += 1
            case ForeignPublishers(names):
                self.foreign = names
            case MotionEnded():
                self.motion_ended = fact
            case CommandUnderWay(identity):
                self.elsewhere = identity
            case Imu() | Joints() | SecondOdometry() | LaserScan():
                pass  # for those who compare them with odometry
            case CommandEnded() | Stopped() | AuthorityUsed():
                pass  # says nothing of the asset's state

    @property
    def pose(self) -> Pose:
        """The compensated pose of base_link: at the origin until odometry comes."""
        if self.odometry is None:
            return Pose()
        raw, offset = self.odometry.pose, self.compensation
        turn_rad = offset.heading_rad
        return Pose(
            x_m=raw.x_m * cos(turn_rad) - raw.y_m * sin(turn_rad) + offset.x_m,
            y_m=raw.x_m * sin(turn_rad) + raw.y_m * cos(turn_rad) + offset.y_m,
            z_m=raw.z_m + offset.z_m,
            heading_rad=wrap_rad(raw.heading_rad + turn_rad),
            roll_rad=raw.roll_rad,
            pitch_rad=raw.pitch_rad,
        )

    @property
    def velocity(self) -> Velocity:
        """The measured velocity of base_link: standing until odometry comes."""
        return STANDING if self.odometry is None else self.odometry.velocity

    @property
    def odometry_age_s(self) -> float:
        """Seconds since odometry last arrived; infinite before the first."""
        return self._clock.now_s() - self._odometry_at_s

    @property
    def odometry_fresh(self) -> bool:
        """Whether odometry is young enough to move by."""
        return self.odometry_age_s <= self._settings.safety.odometry_stale_s

    @property
    def standing(self) -> bool:
        """Whether fresh odometry says that the rover stands."""
        if self.odometry is None or not self.odometry_fresh:
            return False
        velocity = self.odometry.velocity
        return (
            abs(velocity.travel_mps) < STANDING_TRAVEL_MPS
            and abs(velocity.rotate_radps) < STANDING_ROTATE_RADPS
        )

    def hazard(self, moving: bool) -> Refusal | None:
        """Return why the rover must stand now, whatever was commanded, or None.

        Stale odometry matters only if a motion goal is under way.
        """
        bounds = self._settings.safety
        if self.jump is not None:
            return self.jump
        if moving and not self.odometry_fresh:
            age_s = self.odometry_age_s
            return Refusal(
                Reason.ODOMETRY_STALE,
                f"odometry is {age_s:.2f} s old",
                (Figure("age", age_s, "s"), Figure("bound", bounds.odometry_stale_s, "s")),
            )
        pose = self.pose
        tilt_rad = max(abs(pose.roll_rad), abs(pose.pitch_rad))
        if tilt_rad > bounds.tilt_rad:
            return Refusal(
                Reason.TILTED,
                f"the rover leans by {tilt_rad:.2f} rad",
                (Figure("tilt", tilt_rad, "rad"), Figure("bound", bounds.tilt_rad, "rad")),
            )
        if self.battery is not None and self.battery.voltage_v < bounds.battery_low_v:
            voltage_v = self.battery.voltage_v
            return Refusal(
                Reason.BATTERY_LOW,
                f"the battery is down to {voltage_v:.1f} V",
                (Figure("voltage", voltage_v, "V"), Figure("bound", bounds.battery_low_v, "V")),
            )
        return None

    def values(self) -> tuple[ParameterValue, ...]:
        """Return all twelve parameters, in the order of their definition.

        What old odometry says is not known now.
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
        if self.battery is not None:
            figures[Parameter.BATERY_VOLTAGE] = self.battery.voltage_v
        if self.camera is not None:
            figures[Parameter.CAM_PAN] = self.camera.pan_rad
            figures[Parameter.CAM_TILT] = self.camera.tilt_rad
        now = self._clock.utc_s()
        return tuple(ParameterValue(name, now, figures.get(name)) for name in Parameter)

    def _observe_odometry(self, fact: Odometry) -> None:
        if not (fact.pose.finite and fact.velocity.finite):
            return
        if self.odometry is not None and self.odometry_fresh and self.jump is None:
            self.jump = self._jump(self.odometry, fact)
        self.odometry = fact
        self._odometry_at_s = self._clock.now_s()

    def _jump(self, before: Odometry, after: Odometry) -> Refusal | None:
        bounds = self._settings.safety
        step_m = hypot(after.pose.x_m - before.pose.x_m, after.pose.y_m - before.pose.y_m)
        turn_rad = abs(wrap_rad(after.pose.heading_rad - before.pose.heading_rad))
        bound_m = bounds.odometry_jump_m + self.odometry_age_s * max(
            abs(before.velocity.travel_mps), abs(after.velocity.travel_mps)
        )
        bound_rad = bounds.odometry_jump_rad + self.odometry_age_s * max(
            abs(before.velocity.rotate_radps), abs(after.velocity.rotate_radps)
        )
        if step_m <= bound_m and turn_rad <= bound_rad:
            return None
        return Refusal(
            Reason.ODOMETRY_JUMPED,
            f"odometry jumped by {step_m:.2f} m and {turn_rad:.2f} rad",
            (
                Figure("jump", step_m, "m"),
                Figure("bound", bound_m, "m"),
                Figure("turn", turn_rad, "rad"),
                Figure("turn bound", bound_rad, "rad"),
            ),
        )
