"""`PoseMonitor` sets the pose uncertainty, from the fault that shows it until evidence lowers it.

Divergence of the odometry pose from other sources is ordinarily irrelevant. A fault that disproves
the pose (`Disproves` in its declaration) opens an episode. Until the fault is over, the uncertainty
is the divergence since the seconds before it. A second odometry measures the error itself, by its
displacement since a frame from before the fault.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final

from executive.faults import Disproves
from executive.safety.evidence import DISCOVERY_GRACE_S
from executive.safety.motion_history import MotionHistory
from executive.safety.pose_divergence import LOOKBACK_S, Divergence, PoseDivergence
from executive.safety.safety import Fault
from executive.settings import Settings
from executive.state import FramePair, PoseDisagreement, Status, Uncertainty, disagreement
from executive.values.clock import Clock
from executive.values.geometry import Point, Pose, wrap_rad

AGREES_M: Final = 0.05
AGREES_PER_M: Final = 0.015
AGREES_RAD: Final = 0.05
"""Tolerances of a confirmation by second odometry: its noise and drift (`state/fusion.py`)."""
SLIP_M: Final = 0.25
"""Distance that a slipping or tipping rover moves without turning a wheel (0.23 m measured)."""
SLID_M: Final = 0.1
"""Minimum slide by the accelerometer: more than its drift in a stop on firm ground."""
NEXT_FRAME_S: Final = 0.1
"""Time from the last evidence of a fault until a frame is free of it."""
COASTING_S: Final = 0.6
"""Stopping time after a kill of the executive: the base's timeout (0.5 s), and braking."""
ORIGIN_M: Final = 0.02
"""Maximum distance from its origin of an odometry that has restarted."""
RESTARTED: Final = "the restart of the executive"
SECOND: Final = "the second odometry"
SLIDE: Final = "a slide by the accelerometer"


@dataclass(frozen=True, slots=True)
class Anchor:
    """A frame of the second odometry as the reference for later ones.

    Attributes:
        at_s: when it was the newest.
        correction: the correction of the position by the second odometry at that time.
    """

    at_s: float
    frame: FramePair
    correction: Point


@dataclass(frozen=True, slots=True)
class StoredPose:
    """State that survives a restart of the process.

    Attributes:
        utc_s: time of the state.
        uncertainty, confirmed: of the pose; the remainder after an operator's confirmation.
        odometry: the newest pose of the odometry, uncorrected.
        still: whether the rover was stationary, with zero velocity commanded.
        disproved: whether a fault was active that disproves the pose.
        anchor: the reference frame of the second odometry, if there is one.
        shown_m: the position error that other sources have shown since.
        correction: the correction of the position by the second odometry.
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
    """Frames of the second odometry: recent ones, and the reference.

    Args:
        clock: the time.
        status: has both odometries.

    Attributes:
        anchor: the reference of later frames; None while the pose is certain, and without a
            frame from before.
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
        """Set a frame from before this moment as the reference, unless there is one."""
        self.anchor = self.anchor or (self._recent[0] if self._recent else None)

    def restart(self, anchor: Anchor | None) -> None:
        """Discard the recent frames, and set another reference, or none."""
        self._recent.clear()
        self.anchor = anchor

    def next(self) -> Anchor | None:
        """Return a frame to compare with the reference; without one, store it for later."""
        fusion, newest = self._status.fusion, self.newest
        if fusion is None or newest is None:
            return None
        if fusion.unconfirmed_since is not None:
            self.anchor = Anchor(newest.at_s, fusion.unconfirmed_since, fusion.correction)
            fusion.unconfirmed_since = self._compared = None
        if newest.frame is self._compared:
            return None
        if self.anchor is None:
            self.add_anchor(newest)
            return None
        return newest if fusion.correction_applied else None

    def add_anchor(self, newest: Anchor) -> None:
        """Store a frame as a possible reference."""
        self.mark_compared(newest)
        self._recent.append(newest)
        while len(self._recent) > 1 and self._recent[1].at_s <= newest.at_s - LOOKBACK_S:
            self._recent.popleft()

    def mark_compared(self, newest: Anchor) -> None:
        """Mark a frame as compared."""
        self._compared = newest.frame


class _Slide:
    """Slide that the accelerometer measures and the wheels do not."""

    def __init__(self, history: MotionHistory) -> None:
        self._history = history
        self._seen_m = self._apart_m = 0.0

    def grown_m(self) -> float:
        """Return the slide since the last call, if it is above `SLID_M`."""
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
    """Updates `Status.uncertainty`; nothing else lowers it.

    Args:
        history: the commands and sensor data.
        status: has both odometries.
        stored: the state of the previous process, if any.
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
        self._from = self._uncertain_since = Divergence()
        self._faulty = self._uncertain = False
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
            if stored.anchor is not None:  # distances count from this start
                frame = replace(stored.anchor.frame, travelled_m=0.0)
                self._frames.restart(replace(stored.anchor, frame=frame))

    def update(self, active: Sequence[Fault]) -> None:
        """Update with the active faults and the sensor data.

        Args:
            active: the faults that have begun and are not over.
        """
        if self._stored is not None:
            self._compare_restart(self._stored)
        status, frames, now_s = self._status, self._frames, self._clock.now_s()
        travelled_m = status.travelled_m
        self._divergence.update(travelled_m)
        disproved = [each for each in active if each.disproves is not None]
        uncertain = bool(disproved or status.uncertainty)
        if uncertain and not self._uncertain:
            status.clear_local_map()
            self._uncertain_since = self._divergence.before
            frames.hold()
        if slid_m := self._slide.grown_m():
            status.grow_uncertainty(slid_m, 0.0, SLIDE)
        if disproved:
            self._grow_by_faults(disproved, now_s)
        elif status.uncertainty:
            driven_m = travelled_m - self._path_m
            position_m = status.uncertainty.position_at_m(driven_m)
            self._status.raise_uncertainty(
                position_m, status.uncertainty.heading_rad, status.uncertainty.cause
            )
        elif frames.anchor is None:
            self._cause = SECOND
        if frames.anchor is None:  # without an earlier frame no later one confirms the pose
            self._confirmed = status.uncertainty
        self._faulty, self._uncertain, self._path_m = bool(disproved), uncertain, travelled_m
        self._compare_frames()
        self._divergence.sample(now_s)

    def confirm(self, uncertainty: Uncertainty) -> None:
        """Set the uncertainty of the present pose, as confirmed by an operator."""
        self._status.uncertainty = self._confirmed = uncertainty
        self._divergence.update(self._status.travelled_m)
        self._divergence.forget()
        self._frames.restart(self._frames.newest if uncertainty else None)
        self._count_from_now()
        self._certain_from_now()

    @property
    def unstored(self) -> bool:
        """Whether a first odometry, or a first frame, was received since the last store."""
        return self._sources != self._stored_sources

    @property
    def _sources(self) -> tuple[bool, bool]:
        return self._status.odometry is not None, self._frames.newest is not None

    def state_to_store(self, still: bool) -> StoredPose | None:
        """Return the state to store; None before the first odometry.

        Args:
            still: whether zero velocity is commanded.
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
        """The position error since the fault by all sensors except the second odometry."""
        since_m, _ = self._divergence.now.since(self._uncertain_since, by_command=False)
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
        if odometry is not None and any(each.last_evidence_s >= now_s for each in faults):
            self._evidence_stamp_s = odometry.stamp_s
        base, self._cause = self._base, faults[-1].name
        self._status.raise_uncertainty(
            base.position_m + position_m, base.heading_rad + heading_rad, self._cause
        )

    def _compare_frames(self) -> None:
        """Update the uncertainty by the newest frame of the second odometry."""
        if self._stored is not None:
            return
        newest, anchor = self._frames.next(), self._frames.anchor
        if newest is None or anchor is None:
            return
        self._raise_by(disagreement(anchor.frame, newest.frame))
        # A frame during the fault shows an error, but confirms nothing.
        if newest.frame.stamp_s >= self._evidence_stamp_s + NEXT_FRAME_S:
            self._frames.mark_compared(newest)
            self._lower_uncertainty(anchor, newest)

    def _raise_by(self, apart: PoseDisagreement) -> None:
        floor, off_m, off_rad = self._confirmed, 0.0, 0.0
        if apart.off_m > AGREES_M + AGREES_PER_M * apart.distance_m:
            off_m = floor.position_m + apart.off_m
        if apart.off_rad > AGREES_RAD:
            off_rad = floor.heading_rad + apart.off_rad
        self._status.raise_uncertainty(off_m, off_rad, self._cause)

    def _lower_uncertainty(self, anchor: Anchor, newest: Anchor) -> None:
        """Lower the uncertainty to what the second odometry confirms.

        Agreement with a position that it has corrected itself is no confirmation: a correction
        beyond the error shown by other sources may be wrong itself.
        """
        apart = disagreement(anchor.frame, newest.frame)
        near_m = AGREES_M + AGREES_PER_M * apart.distance_m
        known, floor = self._status.uncertainty, self._confirmed
        position_m, heading_rad = known.position_m, known.heading_rad
        corrected_m = anchor.correction.distance_m(newest.correction)
        if corrected_m > near_m + self._shown_m:
            position_m = max(position_m, floor.position_m + corrected_m)
        elif apart.off_m <= near_m:
            position_m = floor.position_m
        else:  # one of both is correct, and the other off by this much
            position_m = min(position_m, floor.position_m + apart.off_m + near_m)
        if apart.off_rad <= AGREES_RAD:
            heading_rad = floor.heading_rad
        self._status.uncertainty = Uncertainty(
            position_m, heading_rad, known.cause or self._cause, known.confirmed_by
        )
        if not self._status.uncertainty:
            self._status.uncertainty = Uncertainty(cause=SECOND)
            self._frames.restart(newest if self._faulty else None)
            self._frames.add_anchor(newest)
            self._certain_from_now()
        self._count_from_now()

    def _certain_from_now(self) -> None:
        self._uncertain_since, self._shown_before_m = self._divergence.now, 0.0

    def _count_from_now(self) -> None:
        """Restart the divergence since the reference."""
        self._base, self._from, self._slip_m = self._status.uncertainty, self._divergence.now, 0.0

    def _compare_restart(self, stored: StoredPose) -> None:
        """Compare the first odometry with the last of the previous process.

        The rover may have been moved in between. Motion that the wheels did not measure is shown
        only by a second odometry, relative to the stored frame.
        """
        odometry = self._status.odometry
        if odometry is None:
            return
        self._stored = None
        now, then = odometry.pose, stored.odometry
        moved_m = then.point.distance_m(now.point)
        turned_rad = abs(wrap_rad(now.heading_rad - then.heading_rad))
        restarted = now.point.distance_m(Point(0.0, 0.0)) < ORIGIN_M <= moved_m
        faults, drive = self._settings.faults, self._settings.drive
        bound_m, bound_rad = faults.odometry_jumped.bound, faults.odometry_heading_jumped.bound
        if not stored.still:
            away_s = max(0.0, self._clock.utc_s() - stored.utc_s)
            bound_m += away_s * drive.travel_speed_mps
            bound_rad += away_s * drive.rotate_speed_radps
            if stored.disproved:  # the failed sensor may not show how far the rover coasted
                moved_m += min(away_s, COASTING_S) * drive.travel_speed_mps
                turned_rad += min(away_s, COASTING_S) * drive.rotate_speed_radps
        silent_s = max(0.0, self._clock.now_s() - self._history.start_s - DISCOVERY_GRACE_S)
        silent_m, silent_rad = (
            silent_s * drive.travel_speed_mps,
            silent_s * drive.rotate_speed_radps,
        )
        if stored.disproved or restarted or moved_m > bound_m or turned_rad > bound_rad:
            self._status.grow_uncertainty(
                max(moved_m, silent_m), max(turned_rad, silent_rad), RESTARTED
            )
        elif silent_s:
            self._status.grow_uncertainty(silent_m, silent_rad, RESTARTED)
