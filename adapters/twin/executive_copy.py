"""`ExecutiveCopy`: the executive of an asset on a kinematic base, in memory."""

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from shutil import rmtree
from typing import Final

from executive.commands import (
    ABOARD_LINK,
    Command,
    FollowPath,
    MoveTo,
    Stop,
)
from executive.core.runner import Executive
from executive.faults import FaultTable, Reaction
from executive.preview import DelegatedMotionBase, KinematicBase
from executive.record import Ledger, Synchronous, connect_to_file
from executive.settings import (
    Controller,
    LinkLossSettings,
    LocomotionKind,
    Sensors,
    Settings,
)
from executive.values.clock import ManualClock
from executive.values.facts import MapToOdom, Odometry
from executive.values.geometry import STANDING, Pose, TargetFrame, wrap_rad
from executive.values.reports import Identity, Stage
from trees import RoverTree

NEVER_LATE_S: Final = 1e9
"""Watchdog of a copy: its clock skips the time at rest."""
STEP_M: Final = 0.01
"""Minimum distance between stored poses at the same heading."""
STEP_RAD: Final = 0.02
_STOPPED: Final = Identity("twin", 1)


@dataclass(frozen=True, slots=True)
class ReportedPose:
    """State that the rover reported.

    Attributes:
        utc_s: time of measurement aboard, seconds since 1970-01-01 UTC.
        pose: in the frame of POS_X and POS_Y.
        travel_speed_mps, rotate_speed_radps: its speed limits; None if unknown.
        stopped: whether it waits for a resume: STOPPED or SAFE.
    """

    utc_s: float
    pose: Pose
    travel_speed_mps: float | None = None
    rotate_speed_radps: float | None = None
    stopped: bool = False


class ExecutiveCopy:
    """An executive on a base that first follows reported poses, then moves by itself.

    While it follows reports, the executive decides by the reported pose: a running motion is then
    as far as that of the rover, and also one that is relative to its start.

    Args:
        settings: settings of the asset; see `copied_settings`.
        folder: new folder for its stop latch.
        reports: reported poses in order; the copy starts at the time of the first.

    Attributes:
        track: its poses, with their times.
        ends: end times of its commands.
    """

    def __init__(self, settings: Settings, folder: Path, reports: Sequence[ReportedPose]) -> None:
        first, last = reports[0], reports[-1]
        self._settings = settings
        self._clock = ManualClock(first.utc_s)
        delegated = settings.locomotion is LocomotionKind.DELEGATED
        kind = DelegatedMotionBase if delegated else KinematicBase
        self._base: KinematicBase | DelegatedMotionBase = kind(self._clock, settings, Pose())
        self._reports = deque(reports)
        self.ends: deque[float] = deque()
        self._before = first
        self._origin = first.pose
        self.track: deque[tuple[float, Pose]] = deque([(first.utc_s, first.pose)])
        folder.mkdir()
        self._folder = folder
        self._ledger = Ledger(
            folder / "ledger", Synchronous.NORMAL, lambda _: connect_to_file(":memory:")
        )
        self.executive = Executive(
            settings=settings,
            clock=self._clock,
            rover=self._base,
            ledger=self._ledger,
            files=folder,
            downlinks=(),
            build_tree=RoverTree,
        )
        self.executive.wake = self._wake
        self._woken = False
        status = self.executive.status
        if last.travel_speed_mps is not None:
            status.travel_speed_mps = last.travel_speed_mps
        if last.rotate_speed_radps is not None:
            status.rotate_speed_radps = last.rotate_speed_radps
        self._observe()
        if last.stopped:
            self.submit(Command(_STOPPED, Stop(), ABOARD_LINK))

    @property
    def utc_s(self) -> float:
        """Its present time."""
        return self._clock.utc_s()

    @property
    def pose(self) -> Pose:
        """Its present pose, in the frame of the reports."""
        return self._origin.compose(self._base.pose)

    def submit(self, command: Command) -> None:
        """Submit a command that arrives now."""
        request = command.request
        if isinstance(request, MoveTo | FollowPath):
            request = replace(request, controller=None)
        command = replace(command, request=request, authority=None, report_progress=False)
        self.executive.submit(command, lambda _: None)
        self._serve()

    def advance(self, until_utc_s: float, ticks: int) -> int:
        """Advance to a time, by at most some ticks; return how many ticks are left."""
        while ticks > 0 and (left_s := until_utc_s - self.utc_s) > 0.0:
            idle_s = self._idle_s(left_s)
            self._clock.advance(idle_s or min(self._settings.tick_s, left_s))
            ticks -= 1
            goals = self.executive.goal_count
            self._base.advance()
            self._observe()
            self.executive.tick()
            self._serve()
            if self.executive.goal_count < goals:
                self.ends.append(self.utc_s)
        return ticks

    def stage_of(self, identity: Identity) -> Stage | None:
        """Return the last stage of a command; None if it is unknown."""
        report = self._ledger.last_report(identity)
        return None if report is None else report.stage

    def pose_at(self, utc_s: float) -> Pose:
        """Return its pose at a time of the track, or the nearest end of that."""
        index = bisect_left(self.track, utc_s, key=lambda each: each[0])
        if index == 0 or index == len(self.track):
            return self.track[max(0, index - 1)][1]
        (before_s, before), (after_s, after) = self.track[index - 1], self.track[index]
        return _between(before, after, (utc_s - before_s) / (after_s - before_s))

    def forget_before(self, utc_s: float) -> None:
        """Drop the track before a time."""
        while len(self.track) > 1 and self.track[1][0] <= utc_s:
            self.track.popleft()
        while self.ends and self.ends[0] <= utc_s:
            self.ends.popleft()

    def close(self) -> None:
        """Delete its files."""
        self.executive.simulate_crash()
        rmtree(self._folder, ignore_errors=True)

    def _idle_s(self, left_s: float) -> float:
        """Return the time to skip because the rover is idle; 0 if it is not."""
        executive = self.executive
        idle = (
            executive.goal_count == 0
            and executive.active_plan is None
            and executive.velocity == STANDING
            and self._base.velocity == STANDING
        )
        if not idle:
            return 0.0
        return left_s if not self._reports else min(left_s, self._reports[0].utc_s - self.utc_s)

    def _observe(self) -> None:
        utc_s, base = self.utc_s, self._base
        while self._reports and self._reports[0].utc_s <= utc_s:
            self._before = self._reports.popleft()
            self._move_to(self._before.pose)
        if self._reports:
            before, after = self._before, self._reports[0]
            part = (utc_s - before.utc_s) / (after.utc_s - before.utc_s)
            self._move_to(_between(before.pose, after.pose, part))
        pose = self.pose
        last_s, last = self.track[-1]
        if utc_s > last_s:
            moved = last.point.distance_m(pose.point) >= STEP_M
            moved |= abs(wrap_rad(last.heading_rad - pose.heading_rad)) >= STEP_RAD
            if moved or len(self.track) < 2 or self.track[-2][1] != last:
                self.track.append((utc_s, pose))
            else:
                self.track[-1] = utc_s, last
        if self._settings.frame is TargetFrame.MAP:
            self.executive.observe(MapToOdom(Pose()))
        for fact in base.facts():
            moved_fact = replace(fact, pose=pose) if isinstance(fact, Odometry) else fact
            self.executive.observe(moved_fact)

    def _move_to(self, pose: Pose) -> None:
        self._origin = pose.compose(self._base.pose.inverse)

    def _wake(self) -> None:
        self._woken = True

    def _serve(self) -> None:
        while self._woken:
            self._woken = False
            self.executive.serve_inbox()


def copied_settings(settings: Settings) -> Settings:
    """Return the settings of a copy: no sensors, no reaction to faults, turn-then-drive."""
    rows = {each.name: getattr(settings.faults, each.name) for each in fields(FaultTable)}
    ignored = {name: replace(row, reaction=Reaction.IGNORE) for name, row in rows.items()}
    return replace(
        settings,
        sensors=Sensors(),
        faults=replace(settings.faults, **ignored),
        safety=replace(settings.safety, watchdog_s=NEVER_LATE_S),
        authority=replace(settings.authority, needed=False),
        link_loss=LinkLossSettings(),
        drive=replace(settings.drive, min_turning_radius_m=None),
        controller=Controller.TURN_DRIVE,
        mpc=replace(settings.mpc, selectable=False),
        navigation=None,
        mux=None,
        battery=None,
    )


def _between(before: Pose, after: Pose, part: float) -> Pose:
    turn_rad = wrap_rad(after.heading_rad - before.heading_rad)
    return Pose(
        before.x_m + part * (after.x_m - before.x_m),
        before.y_m + part * (after.y_m - before.y_m),
        heading_rad=wrap_rad(before.heading_rad + part * turn_rad),
    )
