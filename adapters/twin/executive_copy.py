"""`ExecutiveCopy`: the executive of an asset on a kinematic base, in memory."""

from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from os import W_OK, access
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from executive.commands import ABOARD_LINK, Command, FollowPath, MoveTo, Stop
from executive.core.runner import Executive
from executive.faults import FaultTable, Reaction
from executive.preview import DelegatedMotionBase, KinematicBase
from executive.record import Ledger, Synchronous, connect_to_file
from executive.settings import Controller, LinkLossSettings, LocomotionKind, Sensors, Settings
from executive.values.clock import ManualClock
from executive.values.facts import MapToOdom, Odometry
from executive.values.geometry import STANDING, Pose, TargetFrame, wrap_rad
from executive.values.reports import Identity, Stage
from trees import RoverTree

NEVER_LATE_S: Final = 1e9
"""Watchdog of a copy: its clock skips the time at rest."""
SHARED_MEMORY: Final = Path("/dev/shm")
"""Folder of a copy's files, if there is one: each start synchronises its stop latch."""
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
        reports: reported poses in order; the copy starts at the time of the first.

    Attributes:
        track: its poses, with their times.
        ends: end times of its commands.
    """

    def __init__(self, settings: Settings, reports: Sequence[ReportedPose]) -> None:
        first, last = reports[0], reports[-1]
        self._settings = settings
        self._clock = ManualClock(first.utc_s)
        delegated = settings.locomotion is LocomotionKind.DELEGATED
        kind = DelegatedMotionBase if delegated else KinematicBase
        self._base: KinematicBase | DelegatedMotionBase = kind(self._clock, settings, Pose())
        self._reported = [(each.utc_s, each.pose) for each in reports]
        self._follows = True
        self.ends: deque[float] = deque()
        self._origin = first.pose
        self.track: deque[tuple[float, Pose]] = deque(self._reported[:1])
        shared = SHARED_MEMORY if access(SHARED_MEMORY, W_OK) else None
        self._folder = TemporaryDirectory(prefix="rover-twin-", dir=shared)
        folder = Path(self._folder.name)
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
            self._clock.advance(left_s if self._is_idle else min(self._settings.tick_s, left_s))
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

    def forget_before(self, utc_s: float) -> None:
        """Drop the track before a time."""
        while len(self.track) > 1 and self.track[1][0] <= utc_s:
            self.track.popleft()
        while self.ends and self.ends[0] <= utc_s:
            self.ends.popleft()

    def close(self) -> None:
        """Delete its files."""
        self.executive.simulate_crash()
        self._folder.cleanup()

    @property
    def _is_idle(self) -> bool:
        executive = self.executive
        return (
            not self._follows
            and executive.goal_count == 0
            and executive.active_plan is None
            and executive.velocity == STANDING
            and self._base.velocity == STANDING
        )

    def _observe(self) -> None:
        utc_s = self.utc_s
        if self._follows:
            self._origin = pose_at(self._reported, utc_s).compose(self._base.pose.inverse)
            self._follows = utc_s < self._reported[-1][0]
        pose = self.pose
        if len(self.track) > 1 and self.track[-2][1] == self.track[-1][1] == pose:
            self.track.pop()
        if utc_s > self.track[-1][0]:
            self.track.append((utc_s, pose))
        if self._settings.frame is TargetFrame.MAP:
            self.executive.observe(MapToOdom(Pose()))
        for fact in self._base.facts():
            moved_fact = replace(fact, pose=pose) if isinstance(fact, Odometry) else fact
            self.executive.observe(moved_fact)

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


def pose_at(track: Sequence[tuple[float, Pose]], utc_s: float) -> Pose:
    """Return the pose at a time of a track, or at the nearest end of it."""
    index = bisect_left(track, utc_s, key=lambda each: each[0])
    if index == 0 or index == len(track):
        return track[max(0, index - 1)][1]
    (before_s, before), (after_s, after) = track[index - 1], track[index]
    part = (utc_s - before_s) / (after_s - before_s)
    turn_rad = wrap_rad(after.heading_rad - before.heading_rad)
    return Pose(
        before.x_m + part * (after.x_m - before.x_m),
        before.y_m + part * (after.y_m - before.y_m),
        heading_rad=wrap_rad(before.heading_rad + part * turn_rad),
    )
