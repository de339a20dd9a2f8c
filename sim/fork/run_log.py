"""`RunLog`: decisions, reports and poses of a run, recorded or forked, on one clock."""

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from math import inf
from typing import Final

from adapters.recording import RunReader
from adapters.recording.replayed import (
    RecordedEntry,
    RecordedMessage,
    differing,
    encode,
    topic_of,
)
from executive.commands import (
    OWN_LINKS,
    Command,
    Precondition,
    PreemptionPolicy,
    Request,
    declaration_of,
)
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    Decision,
    Entry,
    FactObserved,
    GroundContact,
    Item,
    ProcessStart,
    ReportSent,
    SimulationItem,
    SolverRequested,
    TelemetrySent,
    TreeChanged,
    Truth,
    is_within,
)
from executive.history import RunHistory
from executive.values.facts import Odometry
from executive.values.geometry import Pose
from executive.values.reports import Identity, Report
from sim.fork.model import CommandOutcome, FirstDifference, ForkRun, TrackPoint
from sim.scenario.model import Crash, Send
from sim.scenario.record import ALMOST_S, TruePose

Step = ProcessStart | RecordedEntry | SimulationItem
"""Item of a recording: a start, an entry with all of its items, or an item of the simulation."""
TRACK_TICKS: Final = 4
_DRIFT_S: Final = 0.001
"""Difference of both clocks that is no rounding."""
DIGITS: Final = 6
"""Decimal digits of seconds: stamps in UTC have no finer ones."""
_AS_OCTETS: Final = (TelemetrySent, TreeChanged)


@dataclass(slots=True)
class RunLog:
    """Collects a run from the items of its recording; times are seconds since the first entry.

    Attributes:
        now_s: time of the last entry.
        core_s, utc_s: time of the first entry, on the core's clock and as UTC.
        decisions: every decision with its time.
        odometry: pose of the odometry at each tick.
        contacts_s: times of contacts with the ground.
        sent: commands, and restarts of the executive, as in a timeline.
        simulation: items on the simulation, and the starts of the executive.
        kinds: types of all items.
    """

    now_s: float = 0.0
    core_s: float | None = None
    utc_s: float = 0.0
    decisions: list[tuple[float, RecordedMessage]] = field(default_factory=list)
    truths: list[TruePose] = field(default_factory=list)
    odometry: list[TruePose] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    requests: dict[Identity, Request] = field(default_factory=dict)
    contacts_s: list[float] = field(default_factory=list)
    sent: list[Send | Crash] = field(default_factory=list)
    simulation: list[SimulationItem | ProcessStart] = field(default_factory=list)
    kinds: set[type] = field(default_factory=set)
    _pose: Pose | None = None
    _before_s: float = 0.0
    _drift_s: float = 0.0

    @classmethod
    def read(cls, steps: Iterable[Step], reader: RunReader) -> "RunLog":
        """Return the log of a recording from the items of its reader."""
        log = cls()
        for step in steps:
            if not isinstance(step, RecordedEntry):
                log.put(step)
                continue
            for item in (step.entry, *step.inputs):
                log.put(item)
            for message in step.decisions:
                if message.topic.kind in _AS_OCTETS:
                    log.decisions.append((log.now_s, message))
                else:
                    log.add(reader.decoded(message), message)
        return log

    def put(self, item: Item) -> None:
        """Add an item of a run."""
        self.add(item, None)

    def add(self, item: Item, message: RecordedMessage | None) -> None:
        """Add an item; with its recorded message, if there is one."""
        self.kinds.add(type(item))
        if isinstance(item, Decision):
            written = message or RecordedMessage(topic_of(item), encode(item))
            self.decisions.append((self.now_s, written))
        elif isinstance(item, Entry) and not is_within(item):
            if self.core_s is None:
                self.core_s, self.utc_s = item.now_s, item.utc_s
            self._before_s, self.now_s = self.now_s, item.now_s - self.core_s
            self._drift_s = item.utc_s - self.utc_s - self.now_s
        match item:
            case FactObserved(fact=Odometry(pose=pose)):
                self._pose = pose
            case CoreCalled(call=CoreCall.START) if self._pose is not None:
                down_s = self.now_s - self._before_s
                self.sent.append(Crash(at_s=self._before_s, crash_s=down_s))
            case GroundContact():
                self.contacts_s.append(self.now_s)
            case CoreCalled(call=CoreCall.TICK) if self._pose is not None:
                self.odometry.append(TruePose(self.now_s, self._pose))
            case CommandDequeued(command=command) if command.identity not in self.requests:
                self.requests[command.identity] = command.request
                if command.link not in OWN_LINKS:
                    self.sent.append(self._send(command))
            case ReportSent(report=report):
                # A live simulation may be slower than UTC, which may also be set.
                drift_s = self._drift_s if abs(self._drift_s) > _DRIFT_S else 0.0
                self.reports.append(replace(report, utc_s=report.utc_s - drift_s))
            case Truth(time_s=time_s, pose=pose):
                self.truths.append(TruePose(time_s - (self.core_s or 0.0), pose))
            case _:
                pass
        if isinstance(item, SimulationItem | ProcessStart) and not isinstance(item, Truth):
            self.simulation.append(item)

    def _send(self, command: Command) -> Send:
        precondition, source = command.precondition or Precondition(), command.identity.source
        after = precondition.after
        return Send(
            at_s=self.now_s,
            command=command.request,
            label=str(command.identity),
            id=command.identity.command_id,
            source=source,
            link=command.link,
            only_at=precondition.at,
            only_after=None if after is None else str(Identity(source, after)),
            only_mode=precondition.mode,
            lifetime_s=command.lifetime_s,
            replace=command.preemption is PreemptionPolicy.REPLACE,
        )

    @property
    def poses(self) -> list[TruePose]:
        """True poses; before the first one those of the odometry."""
        first_s = self.truths[0].time_s - ALMOST_S if self.truths else inf
        return [*(each for each in self.odometry if each.time_s < first_s), *self.truths]

    def track(self) -> tuple[TrackPoint, ...]:
        """Return the positions of the odometry, one for each `TRACK_TICKS`."""
        points = ((each.time_s, each.pose) for each in self.odometry[::TRACK_TICKS])
        return tuple(TrackPoint(time_s, pose.x_m, pose.y_m) for time_s, pose in points)

    def outcomes(self) -> tuple[CommandOutcome, ...]:
        """Return the outcome of each command, in the order of their receipt."""
        histories = RunHistory(self.utc_s, tuple(self.reports)).command_histories()
        return tuple(
            self._outcome(identity, history.stages[-1])
            for identity, history in histories.items()
            if history.stages
        )

    def _outcome(self, identity: Identity, last: Report) -> CommandOutcome:
        request = self.requests.get(identity)
        end_s = round(last.utc_s - self.utc_s, DIGITS)
        return CommandOutcome(
            command=str(identity),
            name="" if request is None else declaration_of(type(request)).name,
            stage="" if last.stage is None else last.stage.name,
            reason="" if last.reason is None else last.reason.name,
            text=last.text,
            end_s=end_s,
            pose=self.pose_at(end_s),
        )

    def pose_at(self, time_s: float) -> Pose | None:
        """Return the true pose at a time, or that of the odometry if none is true."""
        poses = self.poses
        index = bisect_right(poses, time_s + 1e-6, key=lambda each: each.time_s)
        return poses[index - 1].pose if index else None


def first_difference(before: ForkRun, after: ForkRun) -> FirstDifference | None:
    """Return the first decision of a run that differs from that of another, while both last.

    A trajectory problem is not one: its start is a measured pose, which differs in the last digits.
    """
    until_s = min(before.outcome.end_s, after.outcome.end_s)
    then, now = _by_time(before, until_s), _by_time(after, until_s)
    for time_s in sorted({*then, *now}):
        if (found := differing(then.get(time_s, ()), now.get(time_s, ()))) is not None:
            return FirstDifference(time_s, found.topic, found.recorded, found.replayed)
    return None


def _by_time(run: ForkRun, until_s: float) -> dict[float, list[RecordedMessage]]:
    found: dict[float, list[RecordedMessage]] = defaultdict(list)
    for time_s, message in run.decisions:
        if time_s <= until_s and message.topic.kind is not SolverRequested:
            found[time_s].append(message)
    return found
