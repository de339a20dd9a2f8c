"""How far the pose may be wrong, from the fault that shows it until evidence says otherwise.

By how much the pose of the odometry goes elsewhere than other sources is ordinarily of no account.
A fault that disproves the pose (`Disproves` in its declaration) opens an episode: what has grown of
it since the seconds before the fault is the uncertainty, until the fault is over. A second odometry
measures the error itself, by its displacement since a frame from before the fault.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final

from executive.faults import Disproves
from executive.safety.comparison import FIRST_HEARD_S
from executive.safety.history import MotionHistory
from executive.safety.pose_divergence import LOOKBACK_S, Divergence, PoseDivergence
from executive.safety.safety import Fault
from executive.settings import Settings
from executive.state import FramePair, PoseDisagreement, Status, Uncertainty, disagreement
from executive.values.clock import Clock
from executive.values.geometry import Point, Pose, wrap_rad

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


class _Frames:
    """Frames of the second odometry: those from before a fault, and the one to compare with.

    Args:
        clock: the time.
        status: has both odometries.

    Attributes:
        anchor: the frame that later ones are compared with; None while the pose is certain, and
            where there is none from before.
    """

    def __init__(self, clock: Clock, status: Status) -> None:
        self._clock, self._status = clock, status
        self.anchor: Anchor | None = None
        self._recent: deque[Anchor] = deque()
        self._compared: FramePair | None = None

    @property
    def newest(self) -> Anchor | None:
        """The newest frame; None before the first one."""
        fusion = self._status.fusion
        if fusion is None or fusion.latest is None:
            return None
        return Anchor(self._clock.now_s(), fusion.latest, fusion.correction)

    def hold(self) -> None:
        """Compare with a frame from before what begins now, unless one is compared with already."""
        self.anchor = self.anchor or (self._recent[0] if self._recent else None)

    def begin_anew(self, anchor: Anchor | None) -> None:
        """Forget the frames from before, and compare with another one, or with none."""
        self._recent.clear()
        self.anchor = anchor

    def next(self) -> Anchor | None:
        """Return a frame to compare with the anchor; one from before whatever comes is kept."""
        fusion, newest = self._status.fusion, self.newest
        if fusion is None or newest is None:
            return None
        if fusion.unconfirmed_since is not None:
            self.anchor = Anchor(newest.at_s, fusion.unconfirmed_since, fusion.correction)
            fusion.unconfirmed_since = self._compared = None
        if newest.frame is self._compared:
            return None
        if self.anchor is None:
            self.keep(newest)
            return None
        return newest if fusion.settled else None

    def keep(self, newest: Anchor) -> None:
        """Keep a frame as one from before whatever comes."""
        self.compared(newest)
        self._recent.append(newest)
        while len(self._recent) > 1 and self._recent[1].at_s <= newest.at_s - LOOKBACK_S:
            self._recent.popleft()

    def compared(self, newest: Anchor) -> None:
        """Do not give this frame again."""
        self._compared = newest.frame


class _Slide:
    """Slide that the accelerometer feels and the wheels do not show."""

    def __init__(self, history: MotionHistory) -> None:
        self._history = history
        self._seen_m = self._apart_m = 0.0

    def grown_m(self) -> float:
        """Return by how much the rover has slid since the last call, where that counts."""
        over_ground = self._history.over_ground
        if over_ground is None:
            return 0.0
        step_m, self._seen_m = over_ground.slid_m - self._seen_m, over_ground.slid_m
        before_m = self._apart_m
        self._apart_m = before_m + step_m if over_ground.apart_s else 0.0  # 0: they agree again
        if self._apart_m <= SLID_M:
            return 0.0
        return step_m if before_m > SLID_M else self._apart_m


class PoseMonitor:
    """Keeps `Status.uncertainty`: nothing else lowers it.

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
        history: MotionHistory,
        status: Status,
        stored: StoredPose | None,
    ) -> None:
        self._clock, self._settings = clock, settings
        self._history, self._status = history, status
        self._divergence, self._slide = PoseDivergence(history), _Slide(history)
        self._frames = _Frames(clock, status)
        self._base = self._confirmed = Uncertainty()
        self._from = self._doubted_from = Divergence()
        self._faulty = self._doubted = False
        self._cause = SECOND
        self._shown_before_m = self._slip_m = self._path_m = 0.0
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
                self._frames.begin_anew(replace(stored.anchor, frame=frame))

    def update(self, active: Sequence[Fault]) -> None:
        """Look at the faults that are there, and at what the sources show.

        Args:
            active: the faults that have begun and are not over.
        """
        if self._stored is not None:
            self._compare_restart(self._stored)
        status, frames, now_s = self._status, self._frames, self._clock.now_s()
        self._divergence.update(status.travelled_m)
        disproved = [each for each in active if each.disproves is not None]
        doubted = bool(disproved or status.uncertainty)
        if doubted and not self._doubted:
            status.forget_seen()
            self._doubted_from = self._divergence.before
            frames.hold()
        if slid_m := self._slide.grown_m():
            status.grow_uncertainty(slid_m, 0.0, SLIDE)
        if disproved:
            self._grow_by_faults(disproved, now_s)
        elif status.uncertainty:
            driven_m = status.travelled_m - self._path_m
            position_m = status.uncertainty.position_at_m(driven_m)
            self._status.raise_uncertainty(
                position_m, status.uncertainty.heading_rad, status.uncertainty.cause
            )
        elif frames.anchor is None:
            self._cause = SECOND
        if frames.anchor is None:  # no frame from before: none later proves anything right
            self._confirmed = status.uncertainty
        self._faulty, self._doubted, self._path_m = bool(disproved), doubted, status.travelled_m
        self._compare_frames()
        self._divergence.sample(now_s)

    def confirm(self, uncertainty: Uncertainty) -> None:
        """Take the pose as it is now as wrong by so much at most, since an operator says so."""
        self._status.uncertainty = self._confirmed = uncertainty
        self._divergence.update(self._status.travelled_m)
        self._divergence.forget()
        self._frames.begin_anew(self._frames.newest if uncertainty else None)
        self._count_from_now()
        self._certain_from_now()

    @property
    def unstored(self) -> bool:
        """Whether odometry, or the second one, has come since anything was stored."""
        return self._sources != self._stored_sources

    @property
    def _sources(self) -> tuple[bool, bool]:
        return self._status.odometry is not None, self._frames.newest is not None

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
            self._frames.anchor or self._frames.newest,
            self._shown_m,
            Point(0.0, 0.0) if status.fusion is None else status.fusion.correction,
        )

    @property
    def _shown_m(self) -> float:
        """The error of the position that sensors but the second odometry show since the fault."""
        since_m, _ = self._divergence.now.since(self._doubted_from, by_command=False)
        return self._shown_before_m + since_m

    def _grow_by_faults(self, faults: Sequence[Fault], now_s: float) -> None:
        now = self._divergence.now
        if not self._faulty:
            self._base, self._slip_m = self._status.uncertainty, SLIP_M
            self._from = self._divergence.before
        shown = {each.disproves for each in faults}
        position_m, heading_rad = now.since(self._from, by_command=shown != {Disproves.SENSORS})
        if Disproves.DISTANCE in shown:
            position_m = max(position_m, self._slip_m + now.path_m - self._from.path_m)
        odometry = self._status.odometry
        if odometry is not None and any(each.seen_s >= now_s for each in faults):
            self._evidence_stamp_s = odometry.stamp_s
        base, self._cause = self._base, faults[-1].name
        self._status.raise_uncertainty(
            base.position_m + position_m, base.heading_rad + heading_rad, self._cause
        )

    def _compare_frames(self) -> None:
        """Let the second odometry say how wrong the pose is, by its newest frame."""
        if self._stored is not None:
            return
        newest, anchor = self._frames.next(), self._frames.anchor
        if newest is None or anchor is None:
            return
        self._raise_by(disagreement(anchor.frame, newest.frame))
        # A frame of the fault's own time shows an error, but proves nothing right.
        if newest.frame.stamp_s >= self._evidence_stamp_s + NEXT_FRAME_S:
            self._frames.compared(newest)
            self._confirm_by(anchor, newest)

    def _raise_by(self, apart: PoseDisagreement) -> None:
        floor, off_m, off_rad = self._confirmed, 0.0, 0.0
        if apart.off_m > AGREES_M + AGREES_PER_M * apart.way_m:
            off_m = floor.position_m + apart.off_m
        if apart.off_rad > AGREES_RAD:
            off_rad = floor.heading_rad + apart.off_rad
        self._status.raise_uncertainty(off_m, off_rad, self._cause)

    def _confirm_by(self, anchor: Anchor, newest: Anchor) -> None:
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
            self._frames.begin_anew(newest if self._faulty else None)
            self._frames.keep(newest)
            self._certain_from_now()
        self._count_from_now()

    def _certain_from_now(self) -> None:
        self._doubted_from, self._shown_before_m = self._divergence.now, 0.0

    def _count_from_now(self) -> None:
        """Count what the sources show from now on."""
        self._base, self._from, self._slip_m = self._status.uncertainty, self._divergence.now, 0.0

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
        silent_s = max(0.0, self._clock.now_s() - self._history.start_s - FIRST_HEARD_S)
        silent_m, silent_rad = (
            silent_s * drive.travel_speed_mps,
            silent_s * drive.rotate_speed_radps,
        )
        if stored.disproved or anew or moved_m > bound_m or turned_rad > bound_rad:
            self._status.grow_uncertainty(
                max(moved_m, silent_m), max(turned_rad, silent_rad), RESTARTED
            )
        elif silent_s:
            self._status.grow_uncertainty(silent_m, silent_rad, RESTARTED)
