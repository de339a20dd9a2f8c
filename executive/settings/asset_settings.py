"""What one asset may do and how it is driven, read from its YAML in `config/`."""

from dataclasses import dataclass, field, replace
from enum import Enum, unique
from itertools import pairwise
from pathlib import Path
from typing import Final

from executive.faults import FaultTable
from executive.obstacles.zones import Footprint, Zones
from executive.settings.controller import Controller
from executive.settings.mpc_settings import MpcSettings
from executive.settings.prediction_settings import BatterySettings, PredictionSettings
from executive.settings.settings_files import (
    HIGHEST_FIGURE,
    config_folder,
    named_file,
    read_yaml,
    require_above_zero,
)

HIGHEST_PORT: Final = 65535
HIGHEST_PRIORITY: Final = 255
FEWEST_MB: Final = 10.0
FEWEST_REPORTS: Final = 1000


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Bounds of the motion, for the arbiter and the intake.

    Attributes:
        braking_mps2: at which the base slows down, at least, when it is told to stand.
    """

    travel_speed_mps: float
    rotate_speed_radps: float
    travel_acceleration_mps2: float
    rotate_acceleration_radps2: float
    distance_m: float
    duration_s: float
    compensation_m: float
    path_waypoints: int
    queue_length: int
    braking_mps2: float = 2.0


class LocomotionKind(Enum):
    """How a rover is made to move: by velocities, or by whole motions of its own."""

    VELOCITY = "velocity"
    WHOLE_MOTION = "whole_motion"


class SpeedProfileKind(Enum):
    """How speed goes with the distance left."""

    TRAPEZOID = "trapezoid"
    SQUARE_ROOT = "square_root"


@dataclass(frozen=True, slots=True)
class TurnDriveSettings:
    """Turn-then-drive.

    Attributes:
        control_point_m: the point that stands still in a spin, this far ahead of base_link.
        latency_s: from a velocity command to the odometry that shows it.
        position_tolerance_m, heading_tolerance_rad: when a goal counts as reached.
    """

    profile: SpeedProfileKind
    reverse: bool
    control_point_m: float
    latency_s: float
    position_tolerance_m: float
    heading_tolerance_rad: float


@dataclass(frozen=True, slots=True)
class CameraLimits:
    """What the camera mast and the camera can do."""

    pan_min_rad: float
    pan_max_rad: float
    tilt_min_rad: float
    tilt_max_rad: float
    rotate_speed_radps: float
    angle_tolerance_rad: float
    capture_deadline_s: float
    formats: tuple[str, ...]
    width_px: int
    height_px: int


@dataclass(frozen=True, slots=True)
class SafetySettings:
    """What stops the rover beside the monitors of `faults`.

    Attributes:
        watchdog_s: for how long the core's thread may hang while the rover moves; a tick later than
            this pauses motion. Longer than what a busy computer or disk delays a tick by; not
            longer than the rover may drive blindly.
    """

    watchdog_s: float = 0.5

    def __post_init__(self) -> None:
        """Raise ValueError where the watchdog has no time."""
        require_above_zero(self, "watchdog_s")


@unique
class Sensor(Enum):
    """What an asset may sense with, beside its odometry; values are the keys of `Sensors`."""

    IMU = "imu"
    JOINTS = "joints"
    SECOND_ODOMETRY = "second_odometry"
    LASER = "laser"


@dataclass(frozen=True, slots=True)
class ImuSettings:
    """An inertial measurement unit, and how often it measures."""

    rate_hz: float

    def __post_init__(self) -> None:
        """Raise ValueError where it never measures."""
        require_above_zero(self, "rate_hz")


@dataclass(frozen=True, slots=True)
class JointsSettings:
    """Sensors of the driven wheels.

    Attributes:
        track_m: between left and right wheels; with skid steering, the effective one.
    """

    rate_hz: float
    wheel_radius_m: float
    track_m: float

    def __post_init__(self) -> None:
        """Raise ValueError where a figure is none."""
        require_above_zero(self, "rate_hz", "wheel_radius_m", "track_m")


@dataclass(frozen=True, slots=True)
class SecondOdometrySettings:
    """An odometry that does not come from the wheels: by camera, laser or satellites.

    Attributes:
        fused: whether it corrects the pose here, where no filter of the rover does.
    """

    rate_hz: float
    fused: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError where it never measures."""
        require_above_zero(self, "rate_hz")


@dataclass(frozen=True, slots=True)
class LaserSettings:
    """A laser that scans a plane through base_link, and how often.

    Attributes:
        zero_is_free: whether its driver reports 0 where nothing reflects, as LDS-01 and URG-04LX
            do, and not infinity (REP 117).
    """

    rate_hz: float
    zero_is_free: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError where it never measures."""
        require_above_zero(self, "rate_hz")


@dataclass(frozen=True, slots=True)
class Sensors:
    """What an asset senses with, beside its odometry; None is not there."""

    imu: ImuSettings | None = None
    joints: JointsSettings | None = None
    second_odometry: SecondOdometrySettings | None = None
    laser: LaserSettings | None = None

    @property
    def present(self) -> frozenset[Sensor]:
        """Those that are there."""
        return frozenset(each for each in Sensor if getattr(self, each.value) is not None)


@dataclass(frozen=True, slots=True)
class AuthoritySettings:
    """Who may command.

    Attributes:
        needed: whether commands need the authority; None for where others than this computer can
            reach the rover.
        lease_s: how long a holder may be silent.
        longest_lease_s: how long at most one may be that gets it by hand-over, such as an orbiter.
        may_take: the sources that may take it from its holder.
        relay: under which name the relay holds it.
    """

    needed: bool | None = None
    lease_s: float = 30.0
    longest_lease_s: float = 86_400.0
    may_take: tuple[str, ...] = ()
    relay: str = "MOPS"

    def __post_init__(self) -> None:
        """Raise ValueError where a lease is none."""
        require_above_zero(self, "lease_s", "longest_lease_s")


class LinkLossAction(Enum):
    """What the rover does when nothing is heard of the ground."""

    GO_ON = "go_on"
    HOLD = "hold"
    STOP = "stop"
    RETURN = "return"


_AFTER: Final = {
    LinkLossAction.STOP: LinkLossAction.RETURN,
    LinkLossAction.RETURN: LinkLossAction.STOP,
}
"""What alone has a meaning after what."""


@dataclass(frozen=True, slots=True)
class LinkLossStage:
    """What is done after so many seconds without a sign of the ground.

    Attributes:
        then: go on; let the command under way end and begin no other until the ground is heard
            again; stop until resumed; or drive back the way the rover came to where the ground was
            last heard.
    """

    after_s: float
    then: LinkLossAction

    def __post_init__(self) -> None:
        """Raise ValueError where it would be reached at once."""
        require_above_zero(self, "after_s")


@dataclass(frozen=True, slots=True)
class LinkLossSettings:
    """The stages of what is done in a mode, the earliest first; without any the rover goes on."""

    teleop: tuple[LinkLossStage, ...] = ()
    motion: tuple[LinkLossStage, ...] = ()
    plan: tuple[LinkLossStage, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError where stages are not in their order."""
        for stages in (self.teleop, self.motion, self.plan):
            for before, after in pairwise(stages):
                if after.after_s <= before.after_s:
                    raise ValueError(
                        f"a stage after {after.after_s:g} s follows one after {before.after_s:g} s:"
                        " the earliest comes first"
                    )
                if _AFTER.get(before.then, after.then) is not after.then:
                    raise ValueError(
                        f"{after.then.value} follows {before.then.value}: only"
                        f" {_AFTER[before.then].value} can"
                    )

    @property
    def returns(self) -> bool:
        """Whether the rover returns in any of them."""
        stages = (*self.teleop, *self.motion, *self.plan)
        return any(each.then is LinkLossAction.RETURN for each in stages)


@dataclass(frozen=True, slots=True)
class VideoSettings:
    """Between which UDP ports the camera's video stream is forwarded.

    Attributes:
        listen_host, listen_port: where sources send it.
        to_host, to_port: where it goes on to.
    """

    listen_host: str
    listen_port: int
    to_host: str
    to_port: int

    def __post_init__(self) -> None:
        """Raise ValueError where a port is none."""
        for port in (self.listen_port, self.to_port):
            if not 0 < port <= HIGHEST_PORT:
                raise ValueError(f"{port} is not a port of 1 to {HIGHEST_PORT}")


@dataclass(frozen=True, slots=True)
class MuxEntry:
    """An input or a lock of a mux, in the words of twist_mux.

    Attributes:
        topic: where it is heard: geometry_msgs/Twist of an input, std_msgs/Bool of a lock.
        timeout: seconds without a message after which an input does not count, and a lock is
            locked; 0 for never.
        priority: an input gives way to others of a higher one, and to locks of a higher one.
    """

    topic: str
    timeout: float
    priority: int

    def __post_init__(self) -> None:
        """Raise ValueError where twist_mux would take something else."""
        if not 0.0 <= self.timeout <= HIGHEST_FIGURE:
            raise ValueError(f"timeout is {self.timeout}: 0 for never, or seconds above it")
        if not 0 <= self.priority <= HIGHEST_PRIORITY:
            raise ValueError(f"priority is {self.priority}: 0 to {HIGHEST_PRIORITY}")


@dataclass(frozen=True, slots=True)
class MuxSettings:
    """The mux between those who publish velocities and the base.

    Attributes:
        input: the input of `topics` that is the executive's own.
        lock: the lock of `locks` that the executive holds while the rover has to stand.
        topics, locks: as in the file of twist_mux.
        stop: the input of `topics` on which the executive publishes zero meanwhile, of the lock's
            priority or a higher one; None: a locked base stops when its own timeout is over.
        lower_may_drive: whether inputs of a lower priority than the executive's may drive the rover
            while it is idle; if not, it is STOPPED when it moves by them.
    """

    input: str
    lock: str
    topics: dict[str, MuxEntry]
    locks: dict[str, MuxEntry]
    stop: str | None = None
    lower_may_drive: bool = True

    def __post_init__(self) -> None:
        """Raise ValueError where the executive's own input or lock is not there, or has no say."""
        for key, name, there in (
            ("input", self.input, self.topics),
            ("lock", self.lock, self.locks),
            ("stop", self.stop, self.topics),
        ):
            if name is not None and name not in there:
                known = ", ".join(there) or "none"
                raise ValueError(f"{key} is {name!r}, which the mux does not have: {known}")
        own, lock = self.topics[self.input].priority, self.locks[self.lock].priority
        if lock <= own:
            raise ValueError(
                f"lock {self.lock} has priority {lock}: it must be above {own}, that of"
                f" {self.input}, or it stops nobody"
            )
        if self.stop is not None and self.topics[self.stop].priority < lock:
            raise ValueError(
                f"stop {self.stop} has priority {self.topics[self.stop].priority}: it must be at"
                f" least {lock}, that of {self.lock}, which masks it otherwise"
            )


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """What is kept of what the executive does, to be replayed.

    Attributes:
        enabled: whether anything is.
        most_mb: of all recordings, beyond which the oldest are deleted, in 10⁶ octets.
        most_days: how old they get.
    """

    enabled: bool = True
    most_mb: float = 1000.0
    most_days: float = 7.0

    def __post_init__(self) -> None:
        """Raise ValueError where nothing could be kept."""
        if not FEWEST_MB <= self.most_mb <= HIGHEST_FIGURE:
            raise ValueError(f"most_mb is {self.most_mb:g}: at least {FEWEST_MB:g}")
        require_above_zero(self, "most_days")


@dataclass(frozen=True, slots=True)
class Settings:
    """One asset.

    Attributes:
        domain: the MAL domain that names it.
        intent_stale_ticks: dead-man: ticks without an intent after which the rover stands.
        faults: what the rover does about each fault.
        rover: the class that speaks with it, `module:Class`; None for a rover on `cmd_vel`.
        kept_reports: how many the ledger keeps at least; commands are forgotten with their last.
        clock_tolerance_s: how far ahead of the clock aboard a command may have been made.
        video: None where the asset has no video stream.
        sensors: what it senses with, beside its odometry.
        mass_kg: what it weighs as it drives; None where that is not known.
        footprint: None where nothing needs it: zones do.
        zones: where it may drive, in the frame of its odometry.
        link_loss: what is done when nothing is heard of the ground.
        controller: what drives to a place, where the rover takes velocities and the command says
            nothing else.
        mpc: what model predictive control knows of the rover.
        mux: None where the base takes velocities from one topic, whoever publishes there.
        prediction: how exactly previews foretell its motion.
        battery: what its battery may give; None where nothing is refused for its sake.
        recording: what `rover-executive` keeps of what it does.
    """

    asset: str
    description: str
    domain: tuple[str, ...]
    tick_s: float
    locomotion: LocomotionKind
    intent_stale_ticks: int
    status_interval_s: float
    drive: DriveLimits
    turn_drive: TurnDriveSettings
    camera: CameraLimits
    safety: SafetySettings = field(default_factory=SafetySettings)
    faults: FaultTable = field(default_factory=FaultTable)
    rover: str | None = None
    kept_reports: int = 100_000
    clock_tolerance_s: float = 10.0
    video: VideoSettings | None = None
    authority: AuthoritySettings = field(default_factory=AuthoritySettings)
    sensors: Sensors = field(default_factory=Sensors)
    mass_kg: float | None = None
    footprint: Footprint | None = None
    zones: Zones = field(default_factory=Zones)
    mux: MuxSettings | None = None
    link_loss: LinkLossSettings = field(default_factory=LinkLossSettings)
    controller: Controller = Controller.TURN_DRIVE
    mpc: MpcSettings = field(default_factory=MpcSettings)
    prediction: PredictionSettings = field(default_factory=PredictionSettings)
    battery: BatterySettings | None = None
    recording: RecordingSettings = field(default_factory=RecordingSettings)

    def __post_init__(self) -> None:
        """Raise ValueError where settings do not fit each other, or their bounds."""
        if self.zones.any and self.footprint is None:
            raise ValueError("zones need footprint, the rover's length_m and width_m")
        offers = "controller is mpc" if self.controller is Controller.MPC else "mpc.offered is true"
        if self.offers_mpc and self.locomotion is not LocomotionKind.VELOCITY:
            raise ValueError(
                f"{offers}: it is for rovers whose locomotion is velocity, not"
                f" {self.locomotion.value}"
            )
        if self.battery is not None and self.prediction.standing_w is None:
            raise ValueError(
                "battery needs prediction.standing_w, travel_j_per_m and rotate_j_per_rad: without"
                " them it is not known what a motion takes of it"
            )
        if self.kept_reports < FEWEST_REPORTS:
            raise ValueError(f"kept_reports is {self.kept_reports}: at least {FEWEST_REPORTS}")
        require_above_zero(self, "clock_tolerance_s", "mass_kg")

    @property
    def offers_mpc(self) -> bool:
        """Whether model predictive control may drive the rover: always, or for a command."""
        return self.controller is Controller.MPC or self.mpc.offered

    def reached(self, *, by_others: bool) -> "Settings":
        """Return what holds where others than this computer can reach the rover, or cannot.

        Commands need the authority where others can, unless the file decides otherwise.
        """
        if self.authority.needed is not None:
            return self
        return replace(self, authority=replace(self.authority, needed=by_others))


def load_settings(asset: str) -> Settings:
    """Return the settings of an asset by name (`jackal`) or by the path of its YAML file.

    Raises:
        SettingsError: there is no such asset or file, or it does not fit.
    """
    if asset.endswith((".yaml", ".yml")):
        return read_yaml(Path(asset), Settings)
    return read_yaml(named_file("asset", asset, config_folder()), Settings)
