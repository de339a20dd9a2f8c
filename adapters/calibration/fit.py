"""`calibrate` fits `turn_drive`, `mpc` and `sensors.joints` of an asset's settings to a drive.

Least squares throughout: latency and rotation from the commands, slip from the true path, track
from the wheels in spins. Figures that the drive does not determine stay near the settings, by a
weak regularisation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

import numpy as np

from adapters.calibration.drive_log import CommandSeries, DriveLog, PoseSeries, Series
from executive.settings import Settings, SlipSettings, YawResponse

GRID_S: Final = 0.01
"""Time step of the model's integration."""
MIN_TURNED_RAD: Final = 6.0
MIN_DRIVEN_M: Final = 5.0
"""Minimum rotation and distance of a usable drive. Chosen, not measured."""
REGULARIZATION: Final = 0.01
"""Weight of the settings relative to the drive, as a fraction of a standard deviation."""
_SETTLED: Final = ("offset_m", "gain_m")
"""Terms of the slip model that odometry with slip compensation uses."""
MAX_LAG_S: Final = 0.3
MAX_DELAY_S: Final = 0.5
TURNING_RADPS: Final = 0.2
SPINNING_MPS: Final = 0.05
MAX_UNEXPLAINED_RATIO: Final = 0.7
"""Maximum residual rate of turn relative to the rate itself: half of its mean square. Chosen."""
WINDOW_S: Final = 0.5
"""Window of the comparison between wheels and rotation."""
DIGITS: Final = 3


class CalibrationError(Exception):
    """A drive is too short, or does not follow its commands; the text gives the figures."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """A fitted figure of the settings.

    Attributes:
        key: dotted, as in the asset's YAML.
    """

    key: str
    before: float | None
    after: float


@dataclass(frozen=True, slots=True)
class Residual:
    """Root mean square difference between the drive and the model of the settings."""

    name: str
    unit: str
    before: float
    after: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """Result of a calibration.

    Attributes:
        travel_scale: true distance over that of the odometry; None without a true path.
    """

    figures: tuple[Fitted, ...]
    residuals: tuple[Residual, ...]
    travel_scale: float | None

    @property
    def settings(self) -> Mapping[str, float]:
        """The new figures, by their keys."""
        return {each.key: each.after for each in self.figures}


def calibrate(log: DriveLog) -> Calibration:
    """Return the figures of the settings, fitted to a drive under these settings.

    The slip of the rover is fitted only with a true path, that in its odometry always. Without a
    path or a key `odometry_slip` the two are taken to be the same.

    Raises:
        CalibrationError: the drive is too short, or does not follow its commands.
    """
    turned_rad = float(np.sum(np.abs(np.diff(log.odometry.heading_rad))))
    driven_m = float(np.sum(np.hypot(np.diff(log.odometry.x_m), np.diff(log.odometry.y_m))))
    if turned_rad < MIN_TURNED_RAD or driven_m < MIN_DRIVEN_M:
        raise CalibrationError(
            f"the rover drove {driven_m:.1f} m and turned by {turned_rad:.1f} rad:"
            f" {MIN_DRIVEN_M:g} m and {MIN_TURNED_RAD:g} rad are needed at least;"
            " `rover calibrate --plan` prints a pattern"
        )
    mpc = log.settings.mpc
    response = _Response(log)
    figures, residuals = _fit_response(log, response)
    known, known_residual, _ = _slip(
        log, log.odometry, mpc.odometry_slip or SlipSettings(), settled=True
    )
    parts: list[tuple[str, tuple[str, ...], SlipSettings | None, SlipSettings]] = [
        ("odometry_slip", _SETTLED, mpc.odometry_slip, known)
    ]
    residuals.append(replace(known_residual, name="odometry's own slip model"))
    scale = None
    if log.reference is not None:
        slip, residual, scale = _slip(log, log.reference, mpc.slip)
        parts.insert(0, ("slip", tuple(each.name for each in fields(slip)), mpc.slip, slip))
        residuals.append(residual)
    elif mpc.odometry_slip is None:
        # The best assumption: the slip is that in the odometry, which needs no correction then.
        parts = [("slip", _SETTLED, mpc.slip, known)]
    for name, names, before, after in parts:
        figures += _differences(f"mpc.{name}", names, before, after)
    figures += _track(log)
    figures = _turn_drive(log.settings, response.latency_s(), known.offset_m) + figures
    return Calibration(tuple(figures), tuple(residuals), scale)


def _turn_drive(settings: Settings, latency_s: float, offset_m: float) -> list[Fitted]:
    """Return the figures of turn-then-drive, to the millisecond and millimetre.

    It steers by the odometry, and so turns about the point that stays in place by the odometry.
    """
    law, latency_s = settings.turn_drive, latency_s + settings.mpc.odometry_age_s
    figures = [Fitted("turn_drive.latency_s", law.latency_s, round(latency_s, 3))]
    if settings.drive.min_turning_radius_m is None:  # a car does not turn on the spot
        point_m = round(offset_m, 3)
        figures.append(Fitted("turn_drive.control_point_m", law.control_point_m, point_m))
    return figures


def _differences(
    prefix: str, names: tuple[str, ...], before: object, after: SlipSettings | YawResponse
) -> list[Fitted]:
    return [
        Fitted(
            f"{prefix}.{name}",
            None if before is None else getattr(before, name),
            _rounded(getattr(after, name)),
        )
        for name in names
    ]


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _rms(residuals: Series) -> float:
    return float(np.sqrt(np.mean(residuals**2)))


def _ramps(commands: CommandSeries, tick_s: float) -> tuple[Series, Series, Series]:
    """Return times, commanded travel and rotation, in ramps of one tick."""
    times_s = np.column_stack((commands.time_s - tick_s, commands.time_s)).ravel()

    def knots(values: Series) -> Series:
        return np.column_stack((np.append(0.0, values[:-1]), values)).ravel()

    return np.maximum.accumulate(times_s), knots(commands.travel_mps), knots(commands.rotate_radps)


def _low_pass(signal: Series, step_s: float, lag_s: float) -> Series:
    """Return a signal after a first-order lag with a time constant."""
    from scipy.signal import lfilter  # slow to import, as is scipy.optimize

    if lag_s <= 0.0:
        return signal
    share = 1.0 - np.exp(-step_s / lag_s)
    followed: Series = lfilter([share], [1.0, share - 1.0], signal)
    return followed


def _true_rotation(yaw: YawResponse, travel: Series, rotate: Series) -> Series:
    """Return the rotation rate of the rover by `YawResponse`, on the grid."""
    travel_mps2 = np.gradient(travel, GRID_S)
    of_turning = (
        yaw.travel * travel
        + yaw.travel_squared * travel**2
        + yaw.speed * np.abs(travel)
        - (yaw.acceleration + yaw.acceleration_travel * travel) * travel_mps2
    )
    late = rotate * np.abs(rotate) * of_turning - yaw.load * travel_mps2 * rotate
    at_once = yaw.gain * rotate - yaw.drag_radps * np.tanh(rotate / yaw.drag_at_radps)
    rotation: Series = at_once + _low_pass(late, GRID_S, yaw.lag_s)
    return rotation


_FITTED: Final = tuple(each.name for each in fields(YawResponse) if each.name != "drag_at_radps")
_DELAY_SCALE_S: Final = 0.02
_SCALE: Final = 0.1
"""Scale of the differences between rovers in the figures of rotation. Chosen, not measured."""


class _Response:
    """Commands, and the mean rates between successive poses of the odometry.

    Attributes:
        turned, driven: mean rate of turn and mean speed between two poses.
    """

    def __init__(self, log: DriveLog) -> None:
        odometry = log.odometry
        self._times_s = odometry.time_s
        self._grid_s = np.arange(odometry.time_s[0], odometry.time_s[-1] + GRID_S, GRID_S)
        self._at_s, *self._commands = _ramps(log.commands, log.settings.tick_s)
        self._passed_s = np.diff(odometry.time_s)
        self.turned = np.diff(odometry.heading_rad) / self._passed_s
        midway = (odometry.heading_rad[1:] + odometry.heading_rad[:-1]) / 2
        dx, dy = np.diff(odometry.x_m), np.diff(odometry.y_m)
        self.driven = (dx * np.cos(midway) + dy * np.sin(midway)) / self._passed_s

    def commanded(self, delay_s: float) -> tuple[Series, Series]:
        """Return commanded travel and rotation on the grid, later by a delay."""
        at_s = self._grid_s - delay_s
        travel, rotate = (np.interp(at_s, self._at_s, each) for each in self._commands)
        return travel, rotate

    def mean(self, rate: Series) -> Series:
        """Return the mean of a rate on the grid between two poses."""
        path = np.cumsum(rate) * GRID_S
        means: Series = np.diff(np.interp(self._times_s, self._grid_s + GRID_S / 2, path))
        return means / self._passed_s

    def latency_s(self) -> float:
        """Return dead time and lag together, with any steady ratios of speeds to commands.

        Turns count on the spot alone: in arcs, tyres have lags of their own.
        """
        spins = np.abs(self.driven) < SPINNING_MPS

        def residuals(figures: Series) -> Series:
            delay_s, lag_s, ahead, turn = figures
            travel, rotate = (
                self.mean(_low_pass(each, GRID_S, lag_s)) for each in self.commanded(delay_s)
            )
            driven = (self.driven - ahead * travel) / _rms(self.driven)
            turned = (self.turned - turn * rotate) / _rms(self.turned)
            return np.concatenate([driven, turned[spins]])

        from scipy.optimize import least_squares

        bounds = ([0.0, 0.0, 0.1, 0.1], [MAX_DELAY_S, MAX_DELAY_S, 3.0, 3.0])
        delay_s, lag_s, *_ = least_squares(residuals, [0.05, 0.05, 1.0, 1.0], bounds=bounds).x
        return float(delay_s + lag_s)


def _fit_response(log: DriveLog, response: _Response) -> tuple[list[Fitted], list[Residual]]:
    """Return latency and response to velocities."""
    before, turned, mean = log.settings.mpc, response.turned, response.mean

    def apart(delay_s: float, yaw: YawResponse) -> tuple[Series, Series]:
        travel, rotate = response.commanded(delay_s)
        return turned - mean(_true_rotation(yaw, travel, rotate)), response.driven - mean(travel)

    start = np.array([before.command_delay_s, *(getattr(before.yaw, n) for n in _FITTED)])
    scales = np.array([_DELAY_SCALE_S, *(_SCALE for _ in _FITTED)])
    sigma = [max(_rms(each), 1e-3) for each in apart(before.command_delay_s, before.yaw)]
    weight = REGULARIZATION * np.sqrt(len(turned))

    def yaw_of(figures: Series) -> YawResponse:
        named = dict(zip(_FITTED, map(float, figures[1:]), strict=True))
        return replace(before.yaw, **named)

    def residuals(scaled: Series) -> Series:
        figures = start + scaled * scales
        both = zip(apart(figures[0], yaw_of(figures)), sigma, strict=True)
        return np.concatenate([*(off / one for off, one in both), weight * scaled])

    lower = np.full(len(start), -np.inf)
    upper = np.full(len(start), np.inf)
    for at, (low, high) in {
        0: (0.0, MAX_DELAY_S),
        1: (0.1, 3.0),
        1 + _FITTED.index("lag_s"): (0.02, 1.0),
    }.items():
        lower[at], upper[at] = ((bound - start[at]) / scales[at] for bound in (low, high))
    from scipy.optimize import least_squares

    found = least_squares(residuals, np.zeros(len(start)), bounds=(lower, upper))
    figures = start + found.x * scales
    delay_s, yaw = _rounded(figures[0]), yaw_of(figures)
    old, new = apart(before.command_delay_s, before.yaw), apart(delay_s, yaw)
    if _rms(new[0]) > MAX_UNEXPLAINED_RATIO * _rms(turned):
        raise CalibrationError(
            f"the rover did not follow these commands: {_rms(new[0]):.2g} of the {_rms(turned):.2g}"
            " rad/s that it turned (rms) remain without a cause; are they those that its base"
            " received?"
        )
    units = (("rate of turn", "rad/s"), ("speed", "m/s"))
    differences = [
        Residual(name, unit, _rms(then), _rms(now))
        for (name, unit), then, now in zip(units, old, new, strict=True)
    ]
    delay = Fitted("mpc.command_delay_s", before.command_delay_s, delay_s)
    return [delay, *_differences("mpc.yaw", _FITTED, before.yaw, yaw)], differences


def _slip(
    log: DriveLog, reference: PoseSeries, before: SlipSettings, settled: bool = False
) -> tuple[SlipSettings, Residual, float]:
    """Return the slip of a rover by a reference, and the true metres per metre of odometry.

    With `settled`, the model has no acceleration and lag terms.
    """
    columns = _Columns(log, reference)
    old = np.array([1.0, before.offset_m, before.gain_m, before.acceleration_s2, before.creep_s2])
    free = np.array([True, True, True, not settled, not settled])

    def solved(lag_s: float) -> tuple[Series, Series]:
        rows, wanted = columns.at(lag_s)
        pull = REGULARIZATION * np.linalg.norm(rows, axis=0)[free] + 1e-9
        left = wanted - rows @ old
        change, *_ = np.linalg.lstsq(
            np.vstack([rows[:, free], np.diag(pull)]),
            np.append(left, np.zeros(free.sum())),
            rcond=None,
        )
        figures = old.copy()
        figures[free] += change
        return figures, wanted - rows @ figures

    def cost(lag_s: float) -> float:
        return float(np.sum(solved(lag_s)[1] ** 2))

    lag_s = 0.0
    if not settled:
        from scipy.optimize import minimize_scalar

        bounds = (0.0, MAX_LAG_S)
        lag_s = float(minimize_scalar(cost, bounds=bounds, method="bounded").x)
    figures, left = solved(lag_s)
    rows, wanted = columns.at(before.lag_s)
    passed_s = columns.passed_s
    residual = Residual(
        "slip", "m/s", _rms((wanted - rows @ old) / passed_s), _rms(left / passed_s)
    )
    scale, offset_m, gain_m, acceleration_s2, creep_s2 = map(float, figures)
    return (
        SlipSettings(offset_m, gain_m, acceleration_s2, creep_s2, _rounded(lag_s)),
        residual,
        scale,
    )


class _Columns:
    """Displacement by each term of a slip model between two reference poses, forward and left."""

    def __init__(self, log: DriveLog, reference: PoseSeries) -> None:
        times_s = log.odometry.time_s
        inside = (reference.time_s >= times_s[0]) & (reference.time_s <= times_s[-1])
        self._at_s = reference.time_s[inside]
        self._times_s, self._heading = times_s, log.odometry.heading_rad
        self._steps_s = np.diff(times_s, prepend=times_s[0])
        self._travel, self._rotate = log.travel_mps, log.rotate_radps
        with np.errstate(divide="ignore", invalid="ignore"):
            gained = np.diff(log.travel_mps, prepend=log.travel_mps[0]) / self._steps_s
        self._gained = np.where(self._steps_s > 0.0, gained, 0.0)
        believed = np.interp(self._at_s, times_s, self._heading)
        self._midway = (believed[1:] + believed[:-1]) / 2
        frame = reference.heading_rad[inside][:-1] - believed[:-1]
        dx, dy = np.diff(reference.x_m[inside]), np.diff(reference.y_m[inside])
        self._moved = (
            dx * np.cos(frame) + dy * np.sin(frame),
            dy * np.cos(frame) - dx * np.sin(frame),
        )
        self.passed_s = np.tile(np.diff(self._at_s), 2)

    def at(self, lag_s: float) -> tuple[Series, Series]:
        """Return the columns for a lag, and the displacement: forward rows, then left ones."""
        step_s = float(np.median(self._steps_s[1:]))
        travel, rotate, gained = self._travel, self._rotate, self._gained
        none = np.zeros_like(travel)
        root = np.copysign(np.sqrt(np.abs(travel * rotate)), travel)
        terms = (
            (travel, none),
            (none, -rotate),
            (none, -_low_pass(root * rotate, step_s, lag_s)),
            (none, _low_pass(gained * rotate, step_s, lag_s)),
            (-_low_pass(gained * np.abs(rotate), step_s, lag_s), none),
        )
        columns = [np.concatenate(self._displacement(ahead, left)) for ahead, left in terms]
        return np.array(columns).T, np.concatenate(self._in_body(*self._moved))

    def _displacement(self, ahead_mps: Series, left_mps: Series) -> tuple[Series, Series]:
        """Return the displacement by body velocities between two poses."""
        before = np.roll(self._heading, 1)
        before[0] = self._heading[0]
        midway = (before + self._heading) / 2
        cosine, sine = np.cos(midway), np.sin(midway)
        paths = (
            np.cumsum(self._steps_s * (ahead_mps * cosine - left_mps * sine)),
            np.cumsum(self._steps_s * (ahead_mps * sine + left_mps * cosine)),
        )
        moved = [np.diff(np.interp(self._at_s, self._times_s, path)) for path in paths]
        return self._in_body(moved[0], moved[1])

    def _in_body(self, x_m: Series, y_m: Series) -> tuple[Series, Series]:
        cosine, sine = np.cos(self._midway), np.sin(self._midway)
        return x_m * cosine + y_m * sine, y_m * cosine - x_m * sine


def _track(log: DriveLog) -> list[Fitted]:
    """Return the effective track of skid steering, from wheels and odometry in spins."""
    joints, wheels = log.settings.sensors.joints, log.wheels
    if joints is None or wheels is None:
        return []
    rims = (wheels.right_radps - wheels.left_radps) * joints.wheel_radius_m
    distances = np.append(0.0, np.cumsum((rims[1:] + rims[:-1]) / 2 * np.diff(wheels.time_s)))
    at_s = np.arange(wheels.time_s[0], wheels.time_s[-1], WINDOW_S)
    rolled = np.diff(np.interp(at_s, wheels.time_s, distances))
    turned = np.diff(np.interp(at_s, log.odometry.time_s, log.odometry.heading_rad))
    travel = np.abs(np.diff(np.interp(at_s, log.odometry.time_s, _travelled_m(log)))) / WINDOW_S
    spins = (np.abs(turned) > TURNING_RADPS * WINDOW_S) & (travel < SPINNING_MPS)
    if not spins.any():
        return []
    track_m = float(np.sum(rolled[spins] * turned[spins]) / np.sum(turned[spins] ** 2))
    return [Fitted("sensors.joints.track_m", joints.track_m, _rounded(track_m))]


def _travelled_m(log: DriveLog) -> Series:
    """Return the distance driven so far, from the speed of the odometry, without sign."""
    steps_s = np.diff(log.odometry.time_s, prepend=log.odometry.time_s[0])
    distances: Series = np.cumsum(np.abs(log.travel_mps) * steps_s)
    return distances
