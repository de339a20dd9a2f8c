"""The missions of `config/plans/missions`, each run without and with the fault that it is made for.

A run is that of the executive over a rover without physics, in simulated time. While the plan only
waits, the clock jumps to the next time that the plan or the scene knows.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from math import inf
from pathlib import Path
from typing import Final

from py_trees.common import Status

from executive.commands import AnswerQuestion, PlanDefinition
from executive.faults import Reaction
from executive.goals import Context
from executive.obstacles.zones import KeepOut, Zones
from executive.plans import FINAL_STATUSES, FORMAT, PlanExecution, PlanNode, PlanRoot, PlanStep
from executive.settings import Settings, config_folder, load_settings
from executive.values.clock import ManualClock
from executive.values.geometry import STANDING, Point, Pose
from executive.values.reports import PlanStatus, PlanUpdate, Stage
from tests.support.kinematic import STEP_S
from tests.support.plans import PlanBench
from trees import RoverTree
from trees.plan import PlanBehaviour, PlanTree
from trees.plan.leaves import CommandLeaf
from trees.plan.node import RUNNING, Answer

FOLDER: Final = config_folder() / "plans" / "missions"
MAX_JUMP_S: Final = 60.0
MAX_TICKS: Final = 200_000
CREEP_MPS: Final = 0.04
"""Below the bound of the monitor of motion at rest."""
ENDS: Final = (*FINAL_STATUSES, PlanStatus.SUSPENDED)
TRACK_M: Final = 0.1
SETTLE_S: Final = 3.0
"""Time before an event without a jump: the monitors of sensors need their history."""


class MissionClock(ManualClock):
    """A clock that begins at a time of the mission."""

    def __init__(self, begin: str) -> None:
        super().__init__()
        self._begin_utc_s = utc_s(begin)

    def utc_s(self) -> float:
        return self._begin_utc_s + self.now_s()


def utc_s(text: str) -> float:
    """Return a time of a mission, seconds since 1970-01-01 UTC."""
    return datetime.fromisoformat(text).timestamp()


def time_of(moment_utc_s: float) -> str:
    """Return the time of day."""
    return datetime.fromtimestamp(round(moment_utc_s), UTC).strftime("%H:%M:%S")


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happens during a run.

    Attributes:
        when: name of the leaf after whose begin it happens, or a time in UTC.
        after_s: time between the two.
        times: which begin of the leaf it is.
    """

    when: str
    act: Callable[["MissionBench"], object]
    after_s: float = 0.0
    times: int = 1


@dataclass(frozen=True, slots=True)
class Scene:
    """What happens beside the plan.

    Attributes:
        title: for the picture.
        contact: whether the ground is in contact at the begin.
        keep_out: corners of an area that the rover may not enter.
        battery_low: reaction to a nearly empty battery, if it is not that of the Jackal.
    """

    title: str
    events: tuple[Event, ...] = ()
    contact: bool = True
    keep_out: tuple[tuple[float, float], ...] = ()
    battery_low: Reaction = Reaction.SAFE

    @property
    def settings(self) -> Settings:
        """The settings of its rover."""
        asset = load_settings("jackal")
        areas = (KeepOut("rocks", self.keep_out),) if self.keep_out else ()
        safety = replace(asset.safety, watchdog_s=2 * MAX_JUMP_S)  # a jump is no late tick
        low = replace(asset.faults.battery_low, reaction=self.battery_low)
        faults = replace(asset.faults, battery_low=low)
        return replace(asset, zones=Zones(keep_out=areas), safety=safety, faults=faults)


@dataclass(frozen=True, slots=True)
class Mission:
    """A mission with its two scenes.

    Attributes:
        name: the name of its file.
        begin: when it is activated, in UTC.
        shortened: a text of the plan, and the one instead of it, so that a run is short.
        folder: that of its file.
    """

    name: str
    begin: str
    nominal: Scene
    fault: Scene
    shortened: tuple[str, str] = ("", "")
    folder: Path = FOLDER

    @property
    def text(self) -> str:
        """The text of the plan."""
        return (self.folder / f"{self.name}.xml").read_text("utf-8").replace(*self.shortened)


@dataclass(slots=True)
class Span:
    """A leaf that was active.

    Attributes:
        result: SUCCESS, FAILURE, HALTED, or RUNNING to the end.
    """

    plan: PlanNode
    begin_utc_s: float
    end_utc_s: float
    result: str = "RUNNING"

    @property
    def is_step(self) -> bool:
        """Whether the leaf has a command."""
        return isinstance(self.plan, PlanStep)


@dataclass(slots=True)
class MissionRun:
    """A mission that was run.

    Attributes:
        last: how the plan ended.
        commands: numbers of the commands, each with its stages.
        motion: times at which the rover moved, each with the voltage of its battery.
    """

    mission: Mission
    scene: Scene
    begin_utc_s: float
    last: PlanUpdate
    pose: Pose
    commands: list[tuple[int, list[Stage]]]
    spans: list[Span]
    track: list[Point]
    motion: list[tuple[float, float]]

    @property
    def course(self) -> str:
        """The leaves with commands in their order, each with the last stage of its command."""
        spans = [each for each in self.spans if each.is_step]
        names = (each.plan.location.name for each in spans)
        ends = zip(names, self.commands, strict=True)
        return ", ".join(f"{name} {stages[-1].name}" for name, (_, stages) in ends)

    def begins(self, name: str) -> list[str]:
        """Return when nodes of a name began, in UTC."""
        return [time_of(each.begin_utc_s) for each in self._named(name)]

    def ends(self, name: str) -> list[str]:
        """Return when nodes of a name ended, in UTC, and how."""
        return [f"{time_of(each.end_utc_s)} {each.result}" for each in self._named(name)]

    def _named(self, name: str) -> Iterator[Span]:
        return (each for each in self.spans if each.plan.location.name == name)


class TracedTree(RoverTree):
    """The tree of the rover; a bench notes the active nodes of its plan."""

    def __init__(self, context: Context, bench: "MissionBench") -> None:
        super().__init__(context)
        self._bench = bench

    def attach(self, plan: PlanRoot, execution: PlanExecution) -> PlanTree:
        tree = super().attach(plan, execution)
        self._bench.trace(tree)
        return tree


class MissionBench(PlanBench):
    """A bench for one run of a mission.

    Attributes:
        contact: whether the ground is in contact.
        creep_m: distance that the rover still slides ahead, slowly and without a command.
        spans: the leaves and time limits that were active.
    """

    creep_m = 0.0

    def __init__(self, folder: Path, mission: Mission, scene: Scene) -> None:
        self.mission, self.contact = mission, scene.contact
        self.spans: list[Span] = []
        self.track: list[Point] = []
        self.motion: list[tuple[float, float]] = []
        self._events = list(scene.events)
        self._tree: PlanTree | None = None
        self._open: dict[int, Span] = {}
        self._statuses = ""
        build_tree = partial(TracedTree, bench=self)
        super().__init__(folder, scene.settings, build_tree, clock=MissionClock(mission.begin))

    def trace(self, tree: PlanTree) -> None:
        """Note the active nodes of a tree."""
        self._tree = tree
        for node in tree.nodes:
            if not node.nodes or node.plan.kind.name in ("Window", "Timeout"):
                vars(node)["execute"] = partial(self._execute, node, node.execute)
                vars(node)["halt"] = partial(self._halt, node, node.halt)

    def _execute(self, node: PlanBehaviour, execute: Callable[[], Answer]) -> Answer:
        was_running = node.status is RUNNING
        answer = execute()
        if isinstance(answer, Status):
            self._note(node, was_running, answer.name)
        return answer

    def _halt(self, node: PlanBehaviour, halt: Callable[[], None]) -> None:
        halt()
        self._note(node, True, "HALTED")

    def _note(self, node: PlanBehaviour, was_running: bool, result: str) -> None:
        """Extend the span of a node, or begin one; a condition that is asked anew has one."""
        span, utc_s = self._open.get(node.number), self.clock.utc_s()
        again = span is not None and span.result == result and utc_s - span.end_utc_s <= STEP_S * 2
        if span is None or not (was_running or again):
            span = self._open[node.number] = Span(node.plan, utc_s, utc_s)
            self.spans.append(span)
        span.end_utc_s, span.result = utc_s, result

    def step(self) -> None:
        """Let a tick pass, with the contact and the events of the scene."""
        for event in self._events[:]:
            if self._due_utc_s(event) <= self.clock.utc_s():
                self._events.remove(event)
                event.act(self)
        if self.contact:
            self.executive.ground.record_contact()
        if self.creep_m > 0.0:
            pose = self.rover.pose
            self.rover.pose = replace(pose, x_m=pose.x_m + CREEP_MPS * STEP_S)
            self.creep_m -= CREEP_MPS * STEP_S
        super().step()
        if self.voltage_v is not None and self.rover.velocity != STANDING:
            self.motion.append((self.clock.utc_s(), self.voltage_v))
        here = self.rover.pose.point
        if not self.track or self.track[-1].distance_m(here) > TRACK_M:
            self.track.append(here)

    def jump(self) -> None:
        """Advance the clock to shortly before anything can happen, if the plan only waits."""
        tree = self._tree
        if tree is None or not tree.waits():
            return
        statuses, before = tree.state().statuses, self._statuses
        self._statuses = statuses
        if statuses != before:
            return
        if self.rover.velocity != STANDING or self.creep_m > 0.0:
            return
        running = [node for node in tree.nodes if node.status is RUNNING]
        if any(isinstance(node, CommandLeaf) for node in running):
            return
        now_s, now_utc_s = self.clock.now_s(), self.clock.utc_s()
        known = [time_s - now_s for time_s in tree.state().timers if time_s is not None]
        utc = [getattr(node, "until_utc_s", None) for node in running]
        utc += [node.plan.ports.get(name) for node in running for name in ("utc", "from", "until")]
        known += [each - now_utc_s for each in utc if isinstance(each, float)]
        known = [each for each in known if each > 0.0]
        known += [self._due_utc_s(event) - now_utc_s for event in self._events]
        left_s = min(known, default=inf) - SETTLE_S
        self.clock.advance(max(0.0, min(left_s, MAX_JUMP_S)))

    def _due_utc_s(self, event: Event) -> float:
        """Return when an event happens; infinity while that is not known."""
        if event.when.endswith("Z"):
            return utc_s(event.when)
        begun = [each.begin_utc_s for each in self.spans if each.plan.location.name == event.when]
        return begun[event.times - 1] + event.after_s if len(begun) >= event.times else inf


def run_mission(mission: Mission, scene: Scene, folder: Path) -> MissionRun:
    """Run a mission to its end."""
    with MissionBench(folder, mission, scene) as bench:
        begin_utc_s = bench.clock.utc_s()
        bench.go(PlanDefinition(mission.name, mission.name, FORMAT, mission.text.encode()))
        for _ in range(MAX_TICKS):
            if bench.status(mission.name).status in ENDS:
                break
            bench.jump()
            bench.step()
        return MissionRun(
            mission,
            scene,
            begin_utc_s,
            bench.status(mission.name),
            bench.rover.pose,
            bench.commanded(mission.name),
            bench.spans,
            bench.track,
            bench.motion,
        )


def charge(ratio: float) -> Callable[[MissionBench], object]:
    """Return an event after which the battery reports a charge."""
    return lambda bench: setattr(bench, "charge_ratio", ratio)


def voltage(value_v: float) -> Callable[[MissionBench], object]:
    """Return an event after which the battery has a voltage."""
    return lambda bench: setattr(bench, "voltage_v", value_v)


def contact(up: bool) -> Callable[[MissionBench], object]:
    """Return an event after which the ground is, or is not, in contact."""
    return lambda bench: setattr(bench, "contact", up)


def camera(works: bool) -> Callable[[MissionBench], object]:
    """Return an event after which the camera works, or sends no frames."""
    return lambda bench: setattr(bench.rover, "camera_works", works)


def displaced(x_m: float, y_m: float) -> Callable[[MissionBench], object]:
    """Return an event that displaces the rover; its odometry notices."""
    return lambda bench: setattr(bench.rover, "pose", Pose(x_m, y_m))


def creep(distance_m: float) -> Callable[[MissionBench], object]:
    """Return an event after which the rover slides ahead slowly."""
    return lambda bench: setattr(bench, "creep_m", distance_m)


def answer(key: str, option: str) -> Callable[[MissionBench], object]:
    """Return an event in which an operator answers a question."""
    return lambda bench: bench.request(AnswerQuestion(bench.mission.name, key, option))


def around(x_m: float, y_m: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a square of 1 m around a point."""
    low_x_m, low_y_m, high_x_m, high_y_m = x_m - 0.5, y_m - 0.5, x_m + 0.5, y_m + 0.5
    return (low_x_m, low_y_m), (high_x_m, low_y_m), (high_x_m, high_y_m), (low_x_m, high_y_m)


DAY: Final = "2026-11-27T"
PASSES: Final = (
    Event(f"{DAY}10:13:00Z", contact(True)),
    Event(f"{DAY}10:22:00Z", contact(False)),
    Event(f"{DAY}12:06:00Z", contact(True)),
    Event(f"{DAY}12:14:00Z", contact(False)),
)
ALL_MISSIONS: Final = (
    Mission(
        "01-day-at-the-outcrop",
        f"{DAY}08:50:00Z",
        Scene("enough battery"),
        Scene("the battery falls to 23.4 V on the way", (Event("outcrop", voltage(23.4), 8.0),)),
    ),
    Mission(
        "02-relay-passes",
        f"{DAY}10:00:00Z",
        Scene("the orbiter passes twice", PASSES, contact=False),
        Scene("no contact at the first pass", PASSES[2:], contact=False),
    ),
    Mission(
        "03-first-reachable",
        f"{DAY}10:00:00Z",
        Scene("the rim can be reached"),
        Scene("the rim is in a keep-out zone", keep_out=around(8.0, 3.0)),
    ),
    Mission(
        "04-ask-before-the-ditch",
        f"{DAY}10:00:00Z",
        Scene("answered after ten minutes: cross", (Event("Ask", answer("Ask", "cross"), 600.0),)),
        Scene("no answer"),
    ),
    Mission(
        "05-traverse-and-charge",
        f"{DAY}10:00:00Z",
        Scene("enough battery"),
        Scene(
            "the battery is low on the second leg, charged after an hour",
            (
                Event("leg", voltage(22.4), 2.0, times=2),
                Event("leg", voltage(22.7), 62.0, times=2),
                Event("leg", voltage(25.1), 3662.0, times=2),
            ),
        ),
    ),
    Mission(
        "06-night",
        f"{DAY}17:00:00Z",
        Scene(
            "charged by 06:30",
            (
                Event(f"{DAY}20:00:00Z", voltage(23.0)),
                Event("2026-11-28T06:30:00Z", voltage(24.5)),
            ),
        ),
        Scene("a cloudy morning", (Event(f"{DAY}20:00:00Z", voltage(23.0)),)),
    ),
    Mission(
        "07-watch-a-stake",
        f"{DAY}10:00:00Z",
        Scene("the rover stands still"),
        Scene(
            "one picture fails; from 10:45 the rover slides by 0.4 m",
            (
                Event(f"{DAY}10:15:00Z", camera(False)),
                Event(f"{DAY}10:25:00Z", camera(True)),
                Event(f"{DAY}10:45:00Z", creep(0.4)),
            ),
        ),
    ),
    Mission(
        "08-patrol",
        f"{DAY}10:00:00Z",
        Scene("all points can be reached"),
        Scene("the second point is in a keep-out zone", keep_out=around(2.0, 2.0)),
        shortened=('msec="7200000"', 'msec="25000"'),
    ),
    Mission(
        "09-stow-in-any-case",
        f"{DAY}10:00:00Z",
        Scene("the camera works"),
        Scene("the camera fails at the second picture", (Event("further", camera(False)),)),
    ),
    Mission(
        "10-link-lost-behind-the-hill",
        f"{DAY}10:00:00Z",
        Scene("in contact all the time"),
        Scene(
            "no contact after 4 s",
            (Event("behind the hill", contact(False), 4.0),),
        ),
        shortened=("@LINK_SILENT_S &lt; 600", "@LINK_SILENT_S &lt; 6"),
    ),
    Mission(
        "11-say-where-it-is",
        f"{DAY}10:00:00Z",
        Scene("answered after half an hour: yes", (Event("Ask", answer("Ask", "yes"), 1800.0),)),
        Scene("no answer"),
    ),
    Mission(
        "12-two-things-at-once",
        f"{DAY}10:00:00Z",
        Scene("the camera works"),
        Scene(
            "no picture on the way",
            (
                Event("drive", camera(False)),
                Event("standing", camera(True)),
            ),
        ),
    ),
)
