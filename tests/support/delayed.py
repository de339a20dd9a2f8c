"""`DelayedLink`: a rover in lock step behind a delay that may lose commands, and its twin."""

from collections import deque
from dataclasses import replace
from itertools import count
from random import Random

from adapters.twin import ReportedPose, Twin
from executive.commands import DIRECT_LINK, Command, Mode, PreemptionPolicy, Request
from executive.values.geometry import Pose
from executive.values.reports import Identity, Report, Stage
from sim.rover.lockstep import LockStep

TELEMETRY_S = 1.0


class DelayedLink:
    """Delivers commands and reports late; reports are never lost.

    Args:
        bench: the rover.
        one_way_s: delay in each direction.
        loss: probability that a command is lost.
        seed: of the losses.

    Attributes:
        twin: the twin, fed as an operator's console feeds it.
        sent: the sent commands, and whether they were lost.
        received: reports that have reached the ground.
        last: the last pose that has.
        arriving: called on each command as it arrives aboard.
    """

    def __init__(self, bench: LockStep, one_way_s: float, loss: float = 0.0, seed: int = 0) -> None:
        self.bench, self.one_way_s = bench, one_way_s
        self.twin = Twin(bench.settings, one_way_s)
        self.sent: list[tuple[Command, bool]] = []
        self.received: list[Report] = []
        self.last: ReportedPose | None = None
        self._loss, self._random = loss, Random(seed)
        self._numbers = count(1)
        self._up: deque[tuple[float, Command]] = deque()
        self._down: deque[tuple[float, Report | ReportedPose]] = deque()
        self._reported = 0
        self._next_pose_s = 0.0

    @property
    def utc_s(self) -> float:
        """Time on the ground, which is that aboard."""
        return self.bench.clock.utc_s()

    def send(self, request: Request, late_s: float = 0.0, **terms: object) -> Identity:
        """Send a command now, which arrives so much later; `terms` are fields of `Command`."""
        identity = Identity("MOE", next(self._numbers))
        command = Command(identity, request, DIRECT_LINK, preemption=PreemptionPolicy.APPEND)
        command = replace(command, **terms)  # type: ignore[arg-type]
        lost = self._random.random() < self._loss
        self.sent.append((command, lost))
        self.twin.on_sent(command, self.utc_s)
        if not lost:
            self._up.append((self.utc_s + self.one_way_s + late_s, command))
        return identity

    def stages(self, identity: Identity) -> list[Stage]:
        """Return the stages of a command that the ground knows."""
        return [each.stage for each in self.received if each.identity == identity and each.stage]

    def step(self) -> None:
        """Advance by one tick: commands arrive, and reports and poses reach the ground."""
        bench = self.bench
        while self._up and self._up[0][0] <= self.utc_s:
            bench.submit(self._up.popleft()[1])
        bench.run(bench.settings.tick_s)
        due_s = self.utc_s + self.one_way_s
        reports = bench.downlink_record.reports
        self._down += ((due_s, each) for each in reports[self._reported :])
        self._reported = len(reports)
        if bench.time_s >= self._next_pose_s:
            self._next_pose_s += TELEMETRY_S
            self._down.append((due_s, self._pose_now()))
        while self._down and self._down[0][0] <= self.utc_s:
            self._on_received(self._down.popleft()[1])

    @property
    def in_transit(self) -> bool:
        """Whether commands are on their way, or the rover has some to do."""
        return bool(self._up) or self.bench.executive.goal_count > 0

    def skip(self, limit_s: float) -> None:
        """Let time pass at once where the rover waits, until a command or report arrives."""
        due = [utc_s for utc_s, _ in self._up]
        due += (utc_s for utc_s, message in self._down if isinstance(message, Report))
        self.bench.skip(min([limit_s, *(each - self.utc_s for each in due)]))

    def run(self, duration_s: float) -> None:
        """Advance by a time."""
        for _ in range(round(duration_s / self.bench.settings.tick_s)):
            self.step()

    @property
    def pose(self) -> Pose:
        """Where the rover believes to be now, which the ground does not know yet."""
        return self.bench.executive.status.pose

    def _pose_now(self) -> ReportedPose:
        status = self.bench.executive.status
        stopped = self.bench.executive.mode in {Mode.STOPPED, Mode.SAFE}
        speeds = status.travel_speed_mps, status.rotate_speed_radps
        return ReportedPose(self.utc_s, status.pose, *speeds, stopped=stopped)

    def _on_received(self, message: Report | ReportedPose) -> None:
        if isinstance(message, ReportedPose):
            self.last = message
            self.twin.on_pose(message)
            return
        self.received.append(message)
        if message.identity is not None and message.stage is not None:
            self.twin.on_stage(message.identity, message.stage, message.utc_s)
