"""How far the pose may be wrong, from the fault that shows it until evidence says otherwise.

Each tick sums up by how much the pose of the odometry goes elsewhere than its own velocity, the
wheels, the gyro and what was commanded. Ordinarily that is of no account. A fault that disproves
the pose (`Disproves` in its declaration) opens an episode: what the sums have grown by since the
seconds before it is the uncertainty, until the fault is over. A second odometry measures the error
itself, by its displacement since a frame from before the fault.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf
from typing import Final, NamedTuple

from executive.clock import Clock
from executive.faults import Disproves
from executive.geometry import Point, Pose, wrap_rad
from executive.safety.channel import Channel
from executive.safety.comparison import FIRST_HEARD_S
from executive.safety.history import History, Moved
from executive.safety.odometry_monitors import REACTION_S
from executive.safety.safety import Fault
from executive.settings import Settings
from executive.state import Disagreement, FramePair, Status, Uncertainty, disagreement

LOOKBACK_S: Final = 5.0
"""Before a fault, in which its cause may have acted: a little over the longest window (4 s)."""
SAMPLE_S: Final = 0.25
AGREES_M: Final = 0.05
AGREES_PER_M: Final = 0.015
AGREES_RAD: Final = 0.05
"""A second odometry confirms the pose within these: its own noise and drift (`state/fusion.py`)."""
SLIP_M: Final = 0.25
"""A rover that slips or tips over may move as far without turning a wheel (0.23 m measured)."""
SLID_M: Final = 0.1
"""Slide by the accelerometer that counts: more than its drift in a stop on firm ground."""
NEXT_FRAME_S: Final = 0.1
"""From the last evidence of a fault until a frame is free of it."""
COASTING_S: Final = 0.6
"""Until a rover whose executive was killed stands: the base's timeout (0.5 s), and braking."""
ORIGIN_M: Final = 0.02
"""An odometry that starts anew starts this near to its origin."""
RESTARTED: Final = "the restart of the executive"
SECOND: Final = "the second odometry"
SLIDE: Final = "a slide by the accelerometer"


class Divergence(NamedTuple):
    """By how much the pose went elsewhere than other sources, summed since the start.

    Attributes:
        ahead_m, left_m, heading_rad: than the odometry's own velocity.
        wheels_m, gyro_rad: than the wheels ahead, and the gyro.
        commanded_m, commanded_rad: than what was commanded.
        path_m: length of the path of the pose itself.
    """

    ahead_m: float = 0.0
    left_m: float = 0.0
    heading_rad: float = 0.0
    wheels_m: float = 0.0
    gyro_rad: float = 0.0
    commanded_m: float = 0.0
    commanded_rad: float = 0.0
    path_m: float = 0.0

    def since(self, before: "Divergence", by_command: bool) -> tuple[float, float]:
        """Return the errors of position and heading that the sources show since, at most.

        Args:
            before: the sums then.
            by_command: whether what was commanded is such a source.
        """
        grown = Divergence(*(abs(new - old) for new, old in zip(self, before, strict=True)))
        heading_rad = max(grown.heading_rad, grown.gyro_rad)
        position_m = max(hypot(grown.ahead_m, grown.left_m), grown.wheels_m)
        if by_command:
            heading_rad = max(heading_rad, grown.commanded_rad)
            position_m = max(position_m, grown.commanded_m)
        return position_m + heading_rad * grown.path_m, heading_rad


class _Comparison:
    """What the pose shows beyond another channel, over the times that both cover.

    Attributes:
        total: summed up since the start, but for gaps of the other channel.
    """

    def __init__(
        self, pose: str, other: Callable[[Sequence[float]], float], later_s: float = 0.0
    ) -> None:
        self.total = 0.0
        self._pose, self._other = Moved._fields.index(pose), other
        self._later_s, self._to_s = later_s, -inf
        self._channel: Channel | None = None
        self._beyond = 0.0

    def advance(self, moved: Channel, other: Channel, bias_per_s: float = 0.0) -> None:
        """Add what is new."""
        from_s, to_s = self._to_s, min(moved.time_s, other.time_s + self._later_s)
        if to_s <= from_s or not (moved.covers(to_s) and other.covers(to_s - self._later_s)):
            return
        beyond = moved.at(to_s)[self._pose] - self._other(other.at(to_s - self._later_s))
        if other is self._channel:  # one that begins anew does so after a gap
            self.total += beyond - self._beyond + bias_per_s * (to_s - from_s)
        self._beyond, self._channel, self._to_s = beyond, other, to_s


@dataclass(frozen=True, slots=True)
class Anchor:
    """A frame of the second odometry that others are compared with.

    Attributes:
        at_s: when it was the newest.
        correction: by which the second odometry had corrected the position then.
    """

    at_s: float
    frame: FramePair
    correction: Point


@dataclass(frozen=True, slots=True)
class StoredPose:
    """What outlives the process.

    Attributes:
        utc_s: when this was.
        uncertainty, confirmed: of the pose; what an operator left of it.
        odometry: the newest pose of the odometry, uncorrected.
        still: whether the rover stood, and was to stand.
        disproved: whether a fault was there that disproves the pose.
        anchor: the frame from which the second odometry tells where the rover is, if there is one.
        shown_m: the error of the position that other sources have shown since.
        correction: by which the second odometry had corrected the position.
    """

    utc_s: float
    uncertainty: Uncertainty
    confirmed: Uncertainty
    odometry: Pose
    still: bool
    disproved: bool
    anchor: Anchor | None
    shown_m: float
    correction: Point


class PoseMonitor:
    """Keeps `Status.uncertainty`: nothing else writes it.

    Args:
        clock: the time.
        settings: of the asset.
        history: what was commanded and sensed.
        status: has both odometries.
        stored: what the process before this one left, if there was one.
    """

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        history: History,
        status: Status,
        stored: StoredPose | None,
    ) -> None:
        self._clock, self._settings = clock, settings
        self._history, self._status = history, status
        self._wheels = _Comparison("pose_ahead_m", lambda sums: (sums[0] + sums[1]) / 2)
        self._gyro = _Comparison("pose_rad", lambda sums: sums[0])
        self._way = _Comparison("pose_ahead_m", lambda sums: sums[0], REACTION_S)
        self._turn = _Comparison("pose_rad", lambda sums: sums[1], REACTION_S)
        self._samples: deque[tuple[float, Divergence]] = deque()
        self._frames: deque[Anchor] = deque()
        self._base = self._confirmed = Uncertainty()
        self._from = self._last = self._doubted_from = Divergence()
        self._faulty = self._doubted = False
        self._cause = SECOND
        self._anchor: Anchor | None = None
        self._compared: FramePair | None = None
        self._shown_before_m = self._slip_m = self._slid_m = self._slide_m = 0.0
        self._evidence_stamp_s = -inf
        self._stored, self._stored_sources = stored, (False, False)
        if stored is not None:
            status.uncertainty, self._confirmed = stored.uncertainty, stored.confirmed
            self._base, self._faulty = stored.uncertainty, stored.disproved
            if status.fusion is not None:
                status.fusion.restore(stored.correction)
            self._shown_before_m = stored.shown_m
            if stored.anchor is not None:  # distances are counted from this start on
                frame = replace(stored.anchor.frame, way_m=0.0)
                self._anchor = replace(stored.anchor, frame=frame)

    def update(self, active: Sequence[Fault]) -> None:
        """Look at the faults that are there, and at what the sources show.

        Args:
            active: the faults that have begun and are not over.
        """
        if self._stored is not None:
            self._compare_restart(self._stored)
        now_s, now = self._clock.now_s(), self._diverged()
        disproved = [each for each in active if each.disproves is not None]
        doubted = bool(disproved or self._status.uncertainty)
        if doubted and not self._doubted:
            self._status.forget_seen()
            self._doubted_from = self._samples[0][1] if self._samples else now
            self._anchor = self._anchor or (self._frames[0] if self._frames else None)
        self._grow_by_slide()
        if disproved:
            self._grow_by_faults(disproved, now, now_s)
        elif self._status.uncertainty:
            self._grow_by_distance(now.path_m - self._last.path_m)
        elif self._anchor is None:
            self._cause = SECOND
        if self._anchor is None:  # no frame from before: none later proves anything right
            self._confirmed = self._status.uncertainty
        self._faulty, self._doubted, self._last = bool(disproved), doubted, now
        self._compare_frames(now, now_s)
        if not self._samples or now_s >= self._samples[-1][0] + SAMPLE_S:
            self._samples.append((now_s, now))
            while len(self._samples) > 1 and self._samples[1][0] <= now_s - LOOKBACK_S:
                self._samples.popleft()

    def confirm(self, uncertainty: Uncertainty) -> None:
        """Take the pose as it is now as wrong by so much at most, since an operator says so."""
        self._status.uncertainty = self._confirmed = uncertainty
        now = self._diverged()
        self._rebase(now)
        self._doubted_from, self._shown_before_m = now, 0.0
        self._samples.clear()
        self._frames.clear()
        self._anchor = self._newest() if uncertainty else None

    @property
    def unstored(self) -> bool:
        """Whether odometry, or the second one, has come since anything was stored."""
        return self._sources != self._stored_sources

    @property
    def _sources(self) -> tuple[bool, bool]:
        return self._status.odometry is not None, self._newest() is not None

    def stored(self, still: bool) -> StoredPose | None:
        """Return what is to outlive the process; None before odometry has come.

        Args:
            still: whether the rover is to stand.
        """
        status, self._stored_sources = self._status, self._sources
        if status.odometry is None or self._stored is not None:
            return self._stored
        return StoredPose(
            self._clock.utc_s(),
            status.uncertainty,
            self._confirmed,
            status.odometry.pose,
            still and status.standing,
            self._faulty,
            self._anchor or self._newest(),
            self._shown_m,
            Point(0.0, 0.0) if status.fusion is None else status.fusion.correction,
        )

    @property
    def _shown_m(self) -> float:
        """The error of the position that sensors but the second odometry show since the fault."""
        return self._shown_before_m + self._last.since(self._doubted_from, by_command=False)[0]

    def _diverged(self) -> Divergence:
        history, moved = self._history, self._history.moved
        if history.wheels is not None:
            self._wheels.advance(moved, history.wheels.sums)
        if history.inertia is not None:
            self._gyro.advance(moved, history.inertia.sums, history.inertia.bias_radps)
        self._way.advance(moved, history.commands)
        self._turn.advance(moved, history.commands)
        sums = Moved(*moved.sums)
        return Divergence(
            sums.ahead_m,
            sums.left_m,
            sums.heading_rad,
            self._wheels.total,
            self._gyro.total,
            self._way.total,
            self._turn.total,
            self._status.travelled_m,
        )

    def _grow_by_faults(self, faults: Sequence[Fault], now: Divergence, now_s: float) -> None:
        if not self._faulty:
            self._base, self._slip_m = self._status.uncertainty, SLIP_M
            self._from = self._samples[0][1] if self._samples else now
        shown = {each.disproves for each in faults}
        position_m, heading_rad = now.since(self._from, by_command=shown != {Disproves.SENSORS})
        if Disproves.DISTANCE in shown:
            position_m = max(position_m, self._slip_m + now.path_m - self._from.path_m)
        odometry = self._status.odometry
        if odometry is not None and any(each.seen_s >= now_s for each in faults):
            self._evidence_stamp_s = odometry.stamp_s
        base, self._cause = self._base, faults[-1].name
        self._raise_to(base.position_m + position_m, base.heading_rad + heading_rad, self._cause)

    def _grow_by_slide(self) -> None:
        """Count a slide that the wheels do not show, from where they last agreed."""
        over_ground, now = self._history.over_ground, self._status.uncertainty
        if over_ground is None:
            return
        slid_m, self._slid_m = over_ground.slid_m - self._slid_m, over_ground.slid_m
        self._slide_m = self._slide_m + slid_m if over_ground.apart_s else 0.0
        if self._slide_m > SLID_M:
            grown_m = slid_m if self._slide_m - slid_m > SLID_M else self._slide_m
            self._raise_to(now.position_m + grown_m, now.heading_rad, SLIDE)

    def _grow_by_distance(self, step_m: float) -> None:
        now = self._status.uncertainty
        self._raise_to(now.position_at_m(step_m), now.heading_rad, now.cause)

    def _raise_to(self, position_m: float, heading_rad: float, cause: str) -> None:
        self._status.raise_uncertainty(position_m, heading_rad, cause)

    def _newest(self) -> Anchor | None:
        fusion = self._status.fusion
        if fusion is None or fusion.latest is None:
            return None
        return Anchor(self._clock.now_s(), fusion.latest, fusion.correction)

    def _compare_frames(self, now: Divergence, now_s: float) -> None:
        """Let the second odometry say how wrong the pose is, by its newest frame."""
        fusion, newest = self._status.fusion, self._newest()
        if fusion is None or newest is None or self._stored is not None:
            return
        if fusion.unconfirmed_since is not None:
            self._anchor = Anchor(now_s, fusion.unconfirmed_since, fusion.correction)
            fusion.unconfirmed_since = self._compared = None
        if newest.frame is self._compared:
            return
        if self._anchor is None:
            self._remember(newest)
        elif fusion.settled:
            self._raise_by(disagreement(self._anchor.frame, newest.frame))
            # A frame of the fault's own time shows an error, but proves nothing right.
            if newest.frame.stamp_s >= self._evidence_stamp_s + NEXT_FRAME_S:
                self._compared = newest.frame
                self._confirm_by(self._anchor, newest, now)

    def _raise_by(self, apart: Disagreement) -> None:
        floor, off_m, off_rad = self._confirmed, 0.0, 0.0
        if apart.off_m > AGREES_M + AGREES_PER_M * apart.way_m:
            off_m = floor.position_m + apart.off_m
        if apart.off_rad > AGREES_RAD:
            off_rad = floor.heading_rad + apart.off_rad
        self._raise_to(off_m, off_rad, self._cause)

    def _confirm_by(self, anchor: Anchor, newest: Anchor, now: Divergence) -> None:
        """Lower what the second odometry confirms.

        That it agrees with a position that it has corrected itself says nothing: a correction
        beyond what other sources show to be wrong may be wrong itself.
        """
        apart = disagreement(anchor.frame, newest.frame)
        near_m = AGREES_M + AGREES_PER_M * apart.way_m
        known, floor = self._status.uncertainty, self._confirmed
        position_m, heading_rad = known.position_m, known.heading_rad
        corrected_m = anchor.correction.distance_m(newest.correction)
        if corrected_m > near_m + self._shown_m:
            position_m = max(position_m, floor.position_m + corrected_m)
        elif apart.off_m <= near_m:
            position_m = floor.position_m
        else:  # one of both is right, and the other wrong by so much
            position_m = min(position_m, floor.position_m + apart.off_m + near_m)
        if apart.off_rad <= AGREES_RAD:
            heading_rad = floor.heading_rad
        self._status.uncertainty = Uncertainty(position_m, heading_rad, known.cause or self._cause)
        if not self._status.uncertainty:
            self._status.uncertainty = Uncertainty(cause=SECOND)
            self._frames.clear()
            self._remember(newest)
            self._anchor = newest if self._faulty else None
            self._doubted_from, self._shown_before_m = now, 0.0
        self._rebase(now)

    def _remember(self, newest: Anchor) -> None:
        """Keep a frame from before whatever comes."""
        self._compared = newest.frame
        self._frames.append(newest)
        while len(self._frames) > 1 and self._frames[1].at_s <= newest.at_s - LOOKBACK_S:
            self._frames.popleft()

    def _rebase(self, now: Divergence) -> None:
        """Count what the sources show from now on."""
        self._base, self._from, self._slip_m = self._status.uncertainty, now, 0.0

    def _compare_restart(self, stored: StoredPose) -> None:
        """Compare the first odometry with the last of the process before this one.

        The rover may have been moved meanwhile. What the wheels did not see only a second odometry
        shows, by the frame that was stored.
        """
        odometry = self._status.odometry
        if odometry is None:
            return
        self._stored = None
        now, then = odometry.pose, stored.odometry
        moved_m = then.point.distance_m(now.point)
        turned_rad = abs(wrap_rad(now.heading_rad - then.heading_rad))
        anew = now.point.distance_m(Point(0.0, 0.0)) < ORIGIN_M <= moved_m
        faults, drive = self._settings.faults, self._settings.drive
        bound_m, bound_rad = faults.odometry_jumped.bound, faults.odometry_turned.bound
        if not stored.still:
            away_s = max(0.0, self._clock.utc_s() - stored.utc_s)
            bound_m += away_s * drive.travel_speed_mps
            bound_rad += away_s * drive.rotate_speed_radps
            if stored.disproved:  # what is wrong may not show how far the rover coasted
                moved_m += min(away_s, COASTING_S) * drive.travel_speed_mps
                turned_rad += min(away_s, COASTING_S) * drive.rotate_speed_radps
        before = self._status.uncertainty
        if stored.disproved or anew or moved_m > bound_m or turned_rad > bound_rad:
            self._raise_to(before.position_m + moved_m, before.heading_rad + turned_rad, RESTARTED)
        silent_s = self._clock.now_s() - self._history.start_s - FIRST_HEARD_S
        if silent_s > 0.0:
            self._raise_to(
                before.position_m + silent_s * drive.travel_speed_mps,
                before.heading_rad + silent_s * drive.rotate_speed_radps,
                RESTARTED,
            )
