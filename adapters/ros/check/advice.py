"""`advise` judges the figures of a check: problems, and the YAML lines of the asset to change."""

from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, replace
from math import atan2, degrees, pi, radians
from pathlib import Path
from typing import Final

from adapters.ros.check.figures import Figures, Mounting, Timing
from executive.settings import TURN_SCALES, FileEdit, Settings, TurnSource, edit_file
from executive.values.geometry import Rotation, inclination

MIN_RATE_HZ: Final = 8.0
RATE_TOLERANCE: Final = 0.15
TWIST_TOLERANCE_S: Final = 0.03
MAX_LEAN_RAD: Final = 0.2
"""Lean of an IMU above which its mounting is the cause, not the ground."""
MAX_YAW_RAD: Final = 0.4
"""The same of its turn about the vertical, found to 0.2 rad in recorded drives."""
RATIO_TOLERANCE: Final = 0.08
"""Deviation of turn or travel between two sources that is reported."""
MAX_CLOCK_OFFSET_S, MAX_AGE_S, MAX_JITTER_S = 0.5, 0.15, 0.1
"""Bounds of arrival minus stamp: more than the first is the offset of two clocks."""
MIN_GAP_S, GAP_PERIODS = 0.3, 3.2
"""Gap of stale odometry."""


@dataclass(frozen=True, slots=True)
class Change:
    """A line of YAML to change.

    Attributes:
        key: dotted.
        in_settings: whether it is in ASSET.yaml; else in ASSET.ros.yaml.
    """

    key: str
    value: float | str
    in_settings: bool = False


@dataclass(frozen=True, slots=True)
class TopicResult:
    """The result of a topic.

    Attributes:
        key: in the parameter file of the asset.
        peers: nodes at the robot's end, with their types.
        timing: None for topics that are sent, or with few messages.
        others: topics that would fit, if the robot does not have this one.
    """

    key: str
    topic: str
    type: str
    peers: tuple[str, ...]
    problems: tuple[str, ...]
    changes: tuple[Change, ...] = ()
    timing: Timing | None = None
    others: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Advice:
    """The meaning of a figure, as text.

    Attributes:
        is_problem: whether it stops the rover; otherwise it informs.
    """

    text: str
    is_problem: bool = False
    changes: tuple[Change, ...] = ()


def advise(settings: Settings, topics: Iterable[TopicResult], found: Figures) -> list[Advice]:
    """Return the meaning of the figures for an asset."""
    times = {each.key: each.timing for each in topics if each.timing is not None}
    return [
        *_rates(settings, times),
        *_clocks(times),
        *(_twist(settings, found) if "odometry" in times else ()),
        *(() if found.mounting is None else _mounting(settings, found.mounting)),
        *_turn(settings, found),
    ]


def _rates(settings: Settings, times: dict[str, Timing]) -> Iterator[Advice]:
    declared = {"odometry": settings.odometry.rate_hz}
    for sensor in settings.sensors.present:
        declared[sensor.value] = getattr(settings.sensors, sensor.value).rate_hz
    for key, rate_hz in declared.items():
        if (timed := times.get(key)) is None:
            continue
        rounded = float(f"{timed.rate_hz:.2g}")
        section = key if key == "odometry" else f"sensors.{key}"
        change = Change(f"{section}.rate_hz", rounded, in_settings=True)
        if rate_hz is None:
            yield Advice(f"{key} arrives at {timed.rate_hz:.1f} Hz", changes=(change,))
        elif abs(timed.rate_hz / rate_hz - 1.0) > RATE_TOLERANCE:
            text = f"{key} arrives at {timed.rate_hz:.1f} Hz; the settings give {rate_hz:g} Hz"
            yield Advice(text, is_problem=True, changes=(change,))
        if key == "odometry" and timed.rate_hz < MIN_RATE_HZ:
            text = f"odometry of {timed.rate_hz:.1f} Hz is too rare: {MIN_RATE_HZ:g} at least"
            yield Advice(text, is_problem=True)
        gap_s = max(MIN_GAP_S, GAP_PERIODS / timed.rate_hz)
        if key == "odometry" and timed.gap_s > gap_s:
            text = f"odometry had a gap of {timed.gap_s:.2f} s: above {gap_s:.2f} s it is stale"
            yield Advice(text, is_problem=True)


def _clocks(times: dict[str, Timing]) -> Iterator[Advice]:
    differing: dict[str, float] = {}
    for key, timed in times.items():
        if timed.jitter_s > MAX_JITTER_S:
            text = f"{key} arrives after its stamps by times that vary by {timed.jitter_s:.2f} s"
            yield Advice(text, is_problem=key == "odometry")
        if timed.age_s > MAX_CLOCK_OFFSET_S or timed.age_s < -MAX_AGE_S:
            differing[key] = timed.age_s
        elif timed.age_s > MAX_AGE_S:
            text = f"{key} arrives {timed.age_s:.2f} s after its stamp"
            yield Advice(text, is_problem=key == "odometry")
    if differing:
        yield Advice(
            f"the stamps of {', '.join(differing)} are {max(differing.values()):.2f} s from this"
            " clock: the clocks differ, the driver does not stamp, or use_sim_time is wrong"
        )


def _twist(settings: Settings, found: Figures) -> Iterator[Advice]:
    if found.noise_m is not None and found.noise_rad is not None:
        noise_mm, noise_deg = 1000 * found.noise_m, degrees(found.noise_rad)
        yield Advice(f"noise of the pose at rest: {noise_mm:.2f} mm, {noise_deg:.3f} deg")
    twist, declared_s = found.twist, settings.odometry.twist_mean_s
    if twist is None:
        yield Advice("the speed hardly changed: the twist cannot be compared (--drive)")
        return
    mean_s = round(twist.mean_s, 2)
    kind = "is momentary"
    if mean_s:
        kind = f"is {mean_s:g} s late" if twist.behind else f"is the mean of {mean_s:g} s"
    text = f"the twist of the odometry {kind} ({twist.error_mps:.3f} m/s are left)"
    differs = declared_s is not None and abs(declared_s - mean_s) > TWIST_TOLERANCE_S
    change = Change("odometry.twist_mean_s", mean_s, in_settings=True)
    changes = (change,) if differs or declared_s is None else ()
    yield Advice(text, is_problem=differs, changes=changes)


def _mounting(settings: Settings, mounting: Mounting) -> Iterator[Advice]:
    imu, yaw_rad = settings.sensors.imu, mounting.yaw_rad or 0.0
    if mounting.lean_rad > MAX_LEAN_RAD or abs(yaw_rad) > MAX_YAW_RAD:
        declared = (imu.mounting if imu else None) or Rotation()
        found = Rotation(*inclination(mounting.up), yaw_rad)
        # Both directions in the axes of the IMU itself: readings are turned as declared.
        up, ahead = (declared.reverse(found.reverse(each)) for each in ((0, 0, 1), (1, 0, 0)))
        lean = Rotation(*(_rounded_rad(each) for each in inclination(up)))
        x, y, _ = lean.apply(ahead)
        needed = replace(lean, yaw_rad=_rounded_rad(-atan2(y, x)))
        axis = max(zip(map(abs, up), up, "xyz", strict=True))
        side = f"{'+' if axis[1] > 0 else '-'}{axis[2]}"
        text = f"the axes of the IMU are not those of base_link: its {side} axis points up"
        unknown = "; yaw needs a drive (--drive)" if mounting.yaw_rad is None else ""
        changes = tuple(
            Change(f"sensors.imu.mounting.{name}", f"{round(degrees(angle))}deg", in_settings=True)
            for name, angle in zip(("roll", "pitch", "yaw"), astuple(needed), strict=True)
        )
        yield Advice(text + unknown, is_problem=True, changes=changes)
    if mounting.off_rad is not None and mounting.off_rad > MAX_LEAN_RAD:
        text = "the orientation of the IMU contradicts gravity by"
        advice = "let its driver omit it (covariance -1)"
        yield Advice(f"{text} {degrees(mounting.off_rad):.0f} deg: {advice}", is_problem=True)
    if not mounting.oriented:
        yield Advice("the IMU gives no orientation: its gyro and accelerations are used")


def _rounded_rad(angle_rad: float) -> float:
    """Return the angle in whole degrees; in right angles if one is near, beyond a slope."""
    right_rad = round(angle_rad / (pi / 2)) * (pi / 2)
    near = abs(angle_rad - right_rad) <= MAX_LEAN_RAD
    return right_rad if near else radians(round(degrees(angle_rad)))


def _turn(settings: Settings, found: Figures) -> Iterator[Advice]:
    ratio, odometry = found.gyro_turn, settings.odometry
    if ratio is not None:
        text = f"the odometry turns {ratio:.2f} × as far as the gyro"
        far = abs(ratio / odometry.turn_scale - 1.0) > RATIO_TOLERANCE
        if far and odometry.turn is TurnSource.ODOMETRY:
            text += ": take the odometry of an EKF, leave the IMU out, or take the gyro's heading"
        chosen: dict[str, float | str] = {"turn": TurnSource.GYRO.value}
        chosen["turn_scale"] = round(ratio, 2)
        usable = far and TURN_SCALES[0] <= ratio <= TURN_SCALES[1]
        changes = [Change(f"odometry.{key}", value, True) for key, value in chosen.items()]
        yield Advice(text, is_problem=far, changes=tuple(changes) if usable else ())
    joints, turn, travel = settings.sensors.joints, found.wheels_turn, found.wheels_travel
    if joints is None:
        return
    radius, changes = 1.0, []
    if travel is not None and abs(travel - 1.0) > RATIO_TOLERANCE:
        radius = 1.0 / travel
        changes.append(_figure("wheel_radius_m", joints.wheel_radius_m * radius))
    if turn is not None and abs(turn * radius - 1.0) > RATIO_TOLERANCE:
        changes.append(_figure("track_m", joints.track_m * turn * radius))
    for name, value in (("travel", travel), ("turn", turn)):
        if value is not None:
            text = f"the wheels {name} {value:.2f} × as far as the body"
            yield Advice(text, is_problem=abs(value - 1.0) > RATIO_TOLERANCE)
    if changes:
        yield Advice("the wheels fit with these figures", changes=tuple(changes))


def _figure(name: str, value: float) -> Change:
    return Change(f"sensors.joints.{name}", float(f"{value:.3g}"), in_settings=True)


def edits(settings: Path, parameters: Path, changes: Iterable[Change]) -> tuple[FileEdit, ...]:
    """Return the two files of an asset with the changes; those without one are left out.

    Args:
        settings: its settings file.
        parameters: its ROS parameter file.
        changes: new values.

    Raises:
        SettingsError: a file cannot be read.
    """
    files: dict[bool, dict[str, float | str]] = {True: {}, False: {}}
    for each in changes:
        files[each.in_settings][each.key] = each.value
    both = (
        (settings, files[True], ()),
        (parameters, files[False], ("/**", "ros__parameters")),
    )
    found = (edit_file(path, values, *root) for path, values, root in both if values)
    return tuple(each for each in found if each.summary)
