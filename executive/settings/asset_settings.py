"""`Settings` of one asset: its limits, sensors and control, read from its YAML in `config/`."""

from dataclasses import dataclass, field, replace
from enum import Enum, unique
from itertools import pairwise
from pathlib import Path
from typing import Final

from executive.faults import FaultTable
from executive.obstacles.zones import Footprint, Zones
from executive.settings.mpc_settings import MpcSettings
from executive.settings.navigation_settings import MuxSettings, NavigationSettings
from executive.settings.prediction_settings import BatterySettings, PredictionSettings
from executive.settings.sensor_settings import OdometrySettings, Sensors, TurnSource
from executive.settings.settings_files import (
    MAX_VALUE,
    config_folder,
    named_file,
    read_yaml,
    require_above_zero,
)
from executive.values.geometry import TargetFrame

MAX_PORT: Final = 65535
MIN_MB: Final = 10.0
MIN_REPORTS: Final = 1000


@unique
class Controller(Enum):
    """Motion controller to targets of a rover that is driven by velocity commands."""

    TURN_DRIVE = "turn_drive"
    MPC = "mpc"
    NAVIGATION = "navigation"


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """Limits of the motion, for the arbiter and the intake.

    Attributes:
        braking_mps2: minimum deceleration of the base when it is commanded to stop.
        min_turning_radius_m: of base_link; None for a base that turns on the spot.
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
    min_turning_radius_m: float | None = None

    def __post_init__(self) -> None:
        """Raise ValueError unless the radius is positive."""
        require_above_zero(self, "min_turning_radius_m")


class LocomotionKind(Enum):
    """Locomotion of a rover: by velocity commands, or by whole motions of its own."""

    VELOCITY = "velocity"
    DELEGATED = "delegated"


class SpeedProfileKind(Enum):
    """Profile of speed over the remaining distance."""

    TRAPEZOID = "trapezoid"
    SQUARE_ROOT = "square_root"


@dataclass(frozen=True, slots=True)
class TurnDriveSettings:
    """Turn-then-drive.

    Attributes:
        control_point_m: distance ahead of base_link of the point about which it spins.
        latency_s: latency from a velocity command to the odometry that shows it.
        position_tolerance_m, heading_tolerance_rad: tolerances of a reached goal.
    """

    profile: SpeedProfileKind
    reverse: bool
    control_point_m: float
    latency_s: float
    position_tolerance_m: float
    heading_tolerance_rad: float


@dataclass(frozen=True, slots=True)
class CameraLimits:
    """Limits of the camera mast, and the camera's formats. By default there is no camera.

    Attributes:
        pan_min_rad, pan_max_rad, tilt_min_rad, tilt_max_rad: ranges; all 0 for a fixed camera.
        formats: formats of its pictures; empty without a camera.
    """

    pan_min_rad: float = 0.0
    pan_max_rad: float = 0.0
    tilt_min_rad: float = 0.0
    tilt_max_rad: float = 0.0
    rotate_speed_radps: float = 1.0
    angle_tolerance_rad: float = 0.02
    capture_deadline_s: float = 5.0
    formats: tuple[str, ...] = ()
    width_px: int = 640
    height_px: int = 480

    @property
    def fixed(self) -> bool:
        """Whether there is no mast that could turn the camera."""
        return self.pan_min_rad == self.pan_max_rad and self.tilt_min_rad == self.tilt_max_rad


@dataclass(frozen=True, slots=True)
class SafetySettings:
    """Safety settings besides the monitors of `faults`.

    Attributes:
        watchdog_s: maximum hang of the core's thread while the rover moves; a tick later than
            this pauses motion. Longer than the delay of a tick on a busy computer or disk; not
            longer than the rover may drive blindly.
    """

    watchdog_s: float = 0.5

    def __post_init__(self) -> None:
        """Raise ValueError unless the watchdog's time is positive."""
        require_above_zero(self, "watchdog_s")


@dataclass(frozen=True, slots=True)
class AuthoritySettings:
    """Settings of the command authority.

    Attributes:
        needed: whether commands need the authority; None: if other hosts can
            reach the rover.
        lease_s: lease of a holder in seconds.
        max_lease_s: maximum lease granted by a hand-over, such as to an orbiter.
        takeover_sources: the sources that may take it from its holder.
        relay: name of the relay as a holder.
    """

    needed: bool | None = None
    lease_s: float = 30.0
    max_lease_s: float = 86_400.0
    takeover_sources: tuple[str, ...] = ()
    relay: str = "MOPS"

    def __post_init__(self) -> None:
        """Raise ValueError unless the leases are positive."""
        require_above_zero(self, "lease_s", "max_lease_s")


@unique
class RosCommands(Enum):
    """When commands of ROS clients are accepted; a stop is accepted always.

    With `WHEN_FREE` not while an operator has goals, a running plan or the authority; ROS clients
    then resume only after a stop of their own, and do not confirm or change the pose.
    """

    OFF = "off"
    WHEN_FREE = "when_free"
    ALWAYS = "always"


@dataclass(frozen=True, slots=True)
class RosSettings:
    """ROS clients that command the rover."""

    commands: RosCommands = RosCommands.OFF


class LinkLossAction(Enum):
    """Action of the rover after the loss of the ground link."""

    CONTINUE = "continue"
    HOLD = "hold"
    STOP = "stop"
    RETURN = "return"


_AFTER: Final = {
    LinkLossAction.STOP: LinkLossAction.RETURN,
    LinkLossAction.RETURN: LinkLossAction.STOP,
}
"""The only action that may follow another one."""


@dataclass(frozen=True, slots=True)
class LinkLossStage:
    """A reaction after a time without contact with the ground.

    Attributes:
        then: continue; finish the active command and start no other until the link is
            recovered; stop until resumed; or drive back along the track to the position of the
            last contact.
    """

    after_s: float
    then: LinkLossAction

    def __post_init__(self) -> None:
        """Raise ValueError unless the time is positive."""
        require_above_zero(self, "after_s")


@dataclass(frozen=True, slots=True)
class LinkLossSettings:
    """The stages of each mode, the earliest first; without stages the rover continues."""

    teleop: tuple[LinkLossStage, ...] = ()
    motion: tuple[LinkLossStage, ...] = ()
    plan: tuple[LinkLossStage, ...] = ()

    def __post_init__(self) -> None:
        """Raise ValueError unless the stages are in order."""
        for stages in (self.teleop, self.motion, self.plan):
            for before, after in pairwise(stages):
                if after.after_s <= before.after_s:
                    raise ValueError(
                        f"a stage after {after.after_s:g} s follows one after {before.after_s:g} s:"
                        " put the earliest first"
                    )
                if _AFTER.get(before.then, after.then) is not after.then:
                    raise ValueError(
                        f"{after.then.value} follows {before.then.value}: only"
                        f" {_AFTER[before.then].value} can"
                    )

    @property
    def returns(self) -> bool:
        """Whether any stage makes the rover return."""
        stages = (*self.teleop, *self.motion, *self.plan)
        return any(each.then is LinkLossAction.RETURN for each in stages)


@dataclass(frozen=True, slots=True)
class VideoSettings:
    """UDP ports between which the camera's video stream is forwarded.

    Attributes:
        listen_host, listen_port: address that sources send it to.
        to_host, to_port: destination of the forwarded stream.
    """

    listen_host: str
    listen_port: int
    to_host: str
    to_port: int

    def __post_init__(self) -> None:
        """Raise ValueError unless the ports are valid."""
        for port in (self.listen_port, self.to_port):
            if not 0 < port <= MAX_PORT:
                raise ValueError(f"{port} is not a port of 1 to {MAX_PORT}")


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """Recording of the executive, for replay.

    Attributes:
        enabled: whether it is recorded.
        max_mb: maximum size of all recordings, in 10⁶ octets; older ones are deleted.
        max_days: maximum age of recordings in days.
    """

    enabled: bool = True
    max_mb: float = 1000.0
    max_days: float = 7.0

    def __post_init__(self) -> None:
        """Raise ValueError unless the limits permit a recording."""
        if not MIN_MB <= self.max_mb <= MAX_VALUE:
            raise ValueError(f"max_mb is {self.max_mb:g}: at least {MIN_MB:g}")
        require_above_zero(self, "max_days")


@dataclass(frozen=True, slots=True)
class Settings:
    """One asset.

    Attributes:
        domain: the MAL domain that names it.
        intent_stale_ticks: dead-man: ticks without an intent after which the rover stops.
        faults: reactions of the rover to each fault.
        rover: the class of its adapter, `module:Class`; None for a rover on `cmd_vel`.
        retained_reports: minimum number of retained reports; commands are deleted with their last.
        clock_tolerance_s: maximum lead of a creation time over the onboard clock.
        video: None if the asset has no video stream.
        odometry: its odometry.
        sensors: sensors besides its odometry.
        mass_kg: its mass as it drives; None if unknown.
        footprint: None if not needed; zones need it.
        zones: permitted areas, in the frame of its odometry.
        link_loss: reactions to the loss of the ground link.
        controller: motion controller to targets, for a rover with velocity commands, unless the
            command selects another.
        frame: frame of waypoints, unless the command names another.
        mpc: model of the rover for model predictive control.
        navigation: the navigation below; None without one.
        mux: None if the base receives velocities from one topic, from any publisher.
        prediction: accuracy of predicted motion.
        battery: battery figures; None if no motion is refused for energy.
        recording: recording of `rover-executive`.
        ros: ROS clients that command the rover.
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
    camera: CameraLimits = field(default_factory=CameraLimits)
    safety: SafetySettings = field(default_factory=SafetySettings)
    faults: FaultTable = field(default_factory=FaultTable)
    rover: str | None = None
    retained_reports: int = 100_000
    clock_tolerance_s: float = 10.0
    video: VideoSettings | None = None
    authority: AuthoritySettings = field(default_factory=AuthoritySettings)
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    sensors: Sensors = field(default_factory=Sensors)
    mass_kg: float | None = None
    footprint: Footprint | None = None
    zones: Zones = field(default_factory=Zones)
    mux: MuxSettings | None = None
    link_loss: LinkLossSettings = field(default_factory=LinkLossSettings)
    controller: Controller = Controller.TURN_DRIVE
    frame: TargetFrame = TargetFrame.ODOM
    mpc: MpcSettings = field(default_factory=MpcSettings)
    navigation: NavigationSettings | None = None
    prediction: PredictionSettings = field(default_factory=PredictionSettings)
    battery: BatterySettings | None = None
    recording: RecordingSettings = field(default_factory=RecordingSettings)
    ros: RosSettings = field(default_factory=RosSettings)

    def __post_init__(self) -> None:
        """Raise ValueError unless all settings are consistent and within bounds."""
        if self.zones.not_empty and self.footprint is None:
            raise ValueError("zones need footprint, the rover's length_m and width_m")
        offers = (
            "controller is mpc" if self.controller is Controller.MPC else "mpc.selectable is true"
        )
        if self.offers_mpc and self.locomotion is not LocomotionKind.VELOCITY:
            raise ValueError(
                f"{offers}: it is for rovers whose locomotion is velocity, not"
                f" {self.locomotion.value}"
            )
        if self.navigation is not None:
            if self.locomotion is not LocomotionKind.VELOCITY:
                raise ValueError(
                    f"navigation needs locomotion velocity, not {self.locomotion.value}"
                )
            self.navigation.check_gate(self.mux)
        elif self.controller is Controller.NAVIGATION:
            raise ValueError("controller is navigation: it needs the section navigation")
        if self.battery is not None and self.prediction.standing_w is None:
            raise ValueError(
                "battery needs prediction.standing_w, travel_j_per_m and rotate_j_per_rad: without"
                " them the energy of a motion is unknown"
            )
        velocity, ahead_m = LocomotionKind.VELOCITY, self.turn_drive.control_point_m
        if self.drive.min_turning_radius_m and (ahead_m or self.locomotion is not velocity):
            raise ValueError(
                "drive.min_turning_radius_m needs locomotion velocity and"
                " turn_drive.control_point_m 0: of a base that cannot turn on the spot, no point"
                " rests in a turn"
            )
        if self.odometry.turn is TurnSource.GYRO and self.sensors.imu is None:
            raise ValueError("odometry.turn is gyro: it needs sensors.imu, with a topic")
        if self.retained_reports < MIN_REPORTS:
            raise ValueError(f"retained_reports is {self.retained_reports}: at least {MIN_REPORTS}")
        require_above_zero(self, "clock_tolerance_s", "mass_kg")

    @property
    def offers_mpc(self) -> bool:
        """Whether model predictive control may drive the rover: by default, or for a command."""
        return self.controller is Controller.MPC or self.mpc.selectable

    @property
    def offers_navigation(self) -> bool:
        """Whether the navigation may drive the rover: by default, or for a command."""
        return self.navigation is not None and (
            self.controller is Controller.NAVIGATION or self.navigation.selectable
        )

    def for_access(self, *, by_others: bool) -> "Settings":
        """Return the settings for a rover that other hosts can reach, or cannot.

        Commands need the authority if other hosts can, unless the file decides otherwise.
        """
        if self.authority.needed is not None:
            return self
        return replace(self, authority=replace(self.authority, needed=by_others))


def load_settings(asset: str) -> Settings:
    """Return the settings of an asset by name (`jackal`) or by the path of its YAML file.

    Raises:
        SettingsError: the asset or file does not exist, or does not fit.
    """
    return read_yaml(asset_file(asset), Settings)


def asset_file(asset: str) -> Path:
    """Return the settings file of an asset, by name (`jackal`, `robots/leo`) or by its path.

    Raises:
        SettingsError: no asset has this name.
    """
    if asset.endswith((".yaml", ".yml")):
        return Path(asset)
    return named_file("asset", asset, config_folder())


def ros_parameter_file(asset: str, folder: Path | None = None) -> Path:
    """Return the ROS parameter file of an asset: in a folder, `config/` or `config/robots/`.

    Args:
        asset: the name in its settings.
        folder: folder of its settings, if known.
    """
    name, config = f"{asset}.ros.yaml", config_folder()
    folders = [config, config / "robots"] if folder is None else [folder, config, config / "robots"]
    return next((each / name for each in folders if (each / name).is_file()), config / name)
