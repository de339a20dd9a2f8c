"""The twelve missions, killed after any tick and anywhere in a commit: is each done as undisturbed?

One undisturbed run of a mission gives what is compared: status of each node, blackboard, executed
commands, questions. A kill leaves the files that the disk has at that moment, and the rover. New
objects of the process start on copies of both, and carry the mission on to its end. They may be
killed again. Some kills are `kill -9` of a real process.
"""

import os
import pickle
import signal
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field
from enum import Enum, unique
from itertools import groupby
from pathlib import Path
from random import Random
from time import perf_counter, process_time
from typing import Final

from executive.commands import ConfirmPose
from executive.plans import FINAL_STATUSES
from executive.plans.recovery import MAX_RESTARTS
from executive.plans.state import decode
from executive.record.writer import Batch
from executive.values.geometry import STANDING
from executive.values.reports import PlanStatus, Stage
from tests.stress.findings import Findings, Log, broken_lifecycles
from tests.support.figures import Figure, Goal
from tests.support.kinematic import STEP_S
from tests.support.mission_bench import PLAN_ID, SITUATIONS, Change, MissionBench, Situation, World

MAX_TICKS: Final = 20_000
REAL: Final = 0.05
"""Share of the kills that are those of a real process."""
MAX_KILLS: Final = 5
"""Of one mission."""
AGAIN: Final = 0.4
"""Share of the runs after a kill that are killed again."""
DOWN_S: Final = (0.0, 0.0, 0.4, 20.0)
"""Times until the process starts again."""
SUSPENDED_S: Final = (0.0, 0.0, 3.0)
"""Times until the operators resume a plan."""
PAGE: Final = 4096
SECTOR: Final = 512
WAL_HEADER: Final = 32
LATE_S: Final = 0.3
"""Time after the end of a wait in which the plan must continue."""


@unique
class Kill(Enum):
    """Where a process is killed."""

    AFTER_TICK = "after a tick"
    BEFORE_COMMIT = "between tick and commit"
    TORN = "within the commit: the file is torn"
    SECTORS = "within the commit: only some sectors are written"
    AFTER_COMMIT = "between commit and start of the commands"
    RECEIVED = "between RECEIVED and ACCEPTED"
    REAL = "kill -9 of a process"


@unique
class Broken(Enum):
    """What no kill may cause."""

    TRACE = "missions that continued differently"
    COMMANDS = "missions with other commands executed"
    END = "missions that ended differently"
    QUESTIONS = "missions with other questions"
    WAITS = "waits that ended too early or too late"
    CONTINUES = "plans that did not continue by themselves"
    SUSPENDED = "plans that continued without being resumed"
    MOVES = "plans that moved the rover while suspended"
    LIFECYCLES = "wrong life cycles of commands"
    LEFT = "states left of plans that have ended"


Files = Mapping[str, bytes]


@dataclass(frozen=True, slots=True)
class Killed:
    """What a kill leaves."""

    kind: Kill
    files: Files
    world: World


def files_of(folder: Path) -> Files:
    """Return the files of an executive, without the index of the log, which a start rebuilds."""
    paths = (path for path in folder.rglob("*") if path.is_file())
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in paths
        if not path.name.endswith("-shm")
    }


def _world(bench: MissionBench) -> World:
    return World(deepcopy(bench.rover), bench.clock.now_s(), len(bench.trace))


def torn(before: Files, after: Files, random: Random, sectors: bool) -> Files:
    """Return files of which the disk has written a part of a commit.

    The log is written first, then synced; only then pages are copied from it to the database.
    """
    main, log = "ledger.sqlite", "ledger.sqlite-wal"
    copied = before[main] != after[main]
    name, unit = (main, PAGE) if copied and random.random() < 0.5 else (log, SECTOR)
    old, new = before.get(name, b""), after.get(name, b"")
    if sectors:
        count = -(-len(new) // unit)
        parts = (new if random.random() < 0.5 else old for _ in range(count))
        mixed = b"".join(
            part[at * unit : (at + 1) * unit].ljust(min(unit, len(new) - at * unit), b"\0")
            for at, part in enumerate(parts)
        )
        if name == log:  # a new header is synced before what follows it
            mixed = new[:WAL_HEADER] + mixed[WAL_HEADER:]
    else:
        first = next((at for at, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), 0)
        first = first or min(len(old), len(new))
        cut = random.randint(min(first, len(new)), len(new))
        mixed = new[:cut] + old[cut:]
    return {**before, **({log: after[log]} if name == main else {}), name: mixed}


def only_received(files: Files, folder: Path) -> Files | None:
    """Return the files as of before the plan's last command was ACCEPTED; None without one."""
    write(files, folder)
    source, path = f"plan:{PLAN_ID}", folder / "ledger.sqlite"
    with sqlite3.connect(path) as database:
        rows = database.execute(
            "SELECT s.command_id, max(r.sequence) FROM stages s JOIN reports r"
            " USING (source, command_id) WHERE s.source = ? AND s.stage = ? AND r.stage = ?"
            " AND r.sequence = (SELECT max(sequence) FROM reports) GROUP BY s.command_id",
            (source, Stage.ACCEPTED.value, Stage.ACCEPTED.value),
        ).fetchall()
        for number, sequence in rows:
            database.execute("DELETE FROM reports WHERE sequence >= ?", (sequence,))
            database.execute(
                "UPDATE stages SET stage = ? WHERE source = ? AND command_id = ?",
                (Stage.RECEIVED.value, source, number),
            )
    database.close()
    return files_of(folder) if rows else None


def write(files: Files, folder: Path) -> None:
    """Write files into a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


class Watch:
    """Takes what kills would leave, at drawn commits and ticks of a run.

    Args:
        wanted: the kills, each with the number of its commit or tick.
    """

    def __init__(self, wanted: Mapping[tuple[bool, int], Sequence[Kill]], random: Random) -> None:
        self.wanted, self.random = dict(wanted), random
        self.taken: list[Killed] = []
        self.commits = self.ticks = 0
        self._before: Files = {}

    def on_commit(self, bench: MissionBench, _batch: Batch, committed: bool) -> None:
        kinds = self.wanted.get((True, self.commits), ())
        self.commits += committed
        if not kinds:
            return
        if not committed:
            self._before = files_of(bench.folder)
            return
        after, world = files_of(bench.folder), _world(bench)
        for kind in kinds:
            files: Files | None = after
            match kind:
                case Kill.BEFORE_COMMIT:
                    files = self._before
                case Kill.TORN | Kill.SECTORS:
                    sectors = kind is Kill.SECTORS
                    files = torn(self._before, after, self.random, sectors)
                case Kill.RECEIVED:
                    with tempfile.TemporaryDirectory() as folder:
                        files = only_received(after, Path(folder))
                case _:
                    pass
            if files is not None:
                self.taken.append(Killed(kind, files, world))
            else:  # no command of the plan was accepted: in the next one
                self.wanted[True, self.commits] = (*self.wanted.get((True, self.commits), ()), kind)

    def on_tick(self, bench: MissionBench) -> None:
        if self.wanted.get((False, self.ticks)):
            self.taken.append(Killed(Kill.AFTER_TICK, files_of(bench.folder), _world(bench)))
        self.ticks += 1


@dataclass(slots=True)
class Outcome:
    """A mission that has ended."""

    status: PlanStatus
    trace: Sequence[Change]
    executed: Mapping[str, int]
    questions: Mapping[str, int]
    commits: int
    ticks: int


def outcome_of(bench: MissionBench, watch: Watch, trace: Sequence[Change]) -> Outcome:
    """Return how a mission ended."""
    assert bench.plan_status is not None
    keys = [
        report.text.partition(", question ")[2].partition(": ")[0]
        for report in bench.received.reports
        if report.identity is None and report.text.startswith(f"plan {PLAN_ID}, question ")
    ]
    executed = dict(bench.seen.executed)
    return Outcome(bench.plan_status, trace, executed, Counter(keys), watch.commits, watch.ticks)


def undisturbed(situation: Situation, resumes: bool, watch: Watch) -> Outcome:
    """Run a mission that is not interrupted."""
    with tempfile.TemporaryDirectory() as folder:
        bench = MissionBench(Path(folder), situation, resumes, watch=watch.on_commit)
        with bench:
            while bench.plan_status not in FINAL_STATUSES:
                bench.proceed()
                watch.on_tick(bench)
                assert watch.ticks < MAX_TICKS, situation.name
            return outcome_of(bench, watch, bench.trace)


class _Given(Exception):  # noqa: N818 - it ends a run, and is no error
    """A run was killed again."""


@dataclass(slots=True)
class Continued:
    """A mission after a kill.

    Args:
        reference: the same mission, undisturbed.
    """

    situation: Situation
    resumes: bool
    reference: Outcome
    random: Random
    find: Callable[[Enum, object], None]
    kills: Counter[Kill] = field(default_factory=Counter)
    before: list[Change] = field(default_factory=list)

    def run(self, killed: Killed) -> None:
        """Start on what a kill left, to the end of the mission, and compare."""
        first = killed
        for number in range(1, MAX_KILLS + 1):
            again = number < MAX_KILLS and self.random.random() < AGAIN
            self.kills[killed.kind] += 1
            with tempfile.TemporaryDirectory() as folder:
                write(killed.files, Path(folder))
                next_kill = self._start(Path(folder), killed, again, first is killed)
            if next_kill is None:
                return
            killed = next_kill

    def _start(self, folder: Path, killed: Killed, again: bool, first: bool) -> Killed | None:
        random, world = self.random, killed.world
        if first:
            self.before = list(self.reference.trace[: world.changes])
        wanted: dict[tuple[bool, int], Sequence[Kill]] = {}
        if again:
            kind = random.choice([each for each in Kill if each is not Kill.REAL])
            at = random.choice((random.randrange(4), random.randrange(60)))
            wanted[kind is not Kill.AFTER_TICK, at] = [kind]
        watch = Watch(wanted, random)
        down_s = random.choice(DOWN_S)
        world.rover.velocity = STANDING
        restarted = World(world.rover, world.now_s + down_s, 0)
        restarts, stored = _stored(folder)
        try:
            bench = MissionBench(
                folder, self.situation, self.resumes, restarted, self._watching(watch)
            )
        except _Given:
            return watch.taken[0]
        with bench:
            try:
                if stored is not None:
                    bench.trace.insert(0, stored)
                self._carry_on(bench, watch, restarts, stored if first else None)
            except _Given:
                self.before += bench.trace[: watch.taken[0].world.changes]
                return watch.taken[0]
            self.compare(bench, watch)
        return None

    @staticmethod
    def _watching(watch: Watch) -> Callable[[MissionBench, Batch, bool], None]:
        def on_commit(bench: MissionBench, batch: Batch, committed: bool) -> None:
            watch.on_commit(bench, batch, committed)
            if watch.taken:
                raise _Given

        return on_commit

    def _carry_on(
        self, bench: MissionBench, watch: Watch, restarts: int, stored: Change | None
    ) -> None:
        """Let a mission continue, by itself or by the operators, to its end."""

        def proceed() -> None:
            bench.proceed()
            watch.on_tick(bench)
            if watch.taken:
                raise _Given

        restarted_s, resumed_s, was = bench.utc_s, bench.utc_s, bench.plan_status
        if was is PlanStatus.SUSPENDED:
            continues = self.resumes and restarts < MAX_RESTARTS
            for _ in range(round(1.0 / STEP_S)):
                if bench.plan_status is not PlanStatus.SUSPENDED:
                    break
                if bench.rover.velocity != STANDING:
                    self.find(Broken.MOVES, self)
                proceed()
            if bench.plan_status is PlanStatus.SUSPENDED:
                uncertain = bench.executive.status.uncertainty
                if continues and not uncertain:
                    self.find(Broken.CONTINUES, f"{self} {restarts} {bench.status(PLAN_ID)}")
                for _ in range(round(self.random.choice(SUSPENDED_S) / STEP_S)):
                    proceed()
                if uncertain:
                    bench.order(ConfirmPose(0.0, 0.0), 98)
                bench.resume(100 + round(bench.utc_s * 1000) % 10**9)
            elif not continues:
                self.find(Broken.SUSPENDED, self)
            resumed_s = bench.utc_s
        while bench.plan_status not in FINAL_STATUSES:
            proceed()
            if watch.ticks >= MAX_TICKS:
                self.find(Broken.END, f"{self} does not end: {bench.status(PLAN_ID)}")
                return
        if was is PlanStatus.SUSPENDED and stored is not None:
            self._check_wait(bench, stored, restarted_s, resumed_s)

    def _check_wait(
        self, bench: MissionBench, stored: Change, restarted_s: float, resumed_s: float
    ) -> None:
        """Compare the end of the wait in which the process was killed."""
        reference = self.reference.trace
        at = next((at for at, each in enumerate(reference) if each.tree == stored.tree), None)
        after = next((each for each in bench.trace if each.tree != stored.tree), None)
        if at is None or after is None or at + 1 >= len(reference):
            return
        expected_s = reference[at + 1].utc_s
        if reference[at].waits == ("Sleep",):
            expected_s += resumed_s - restarted_s
        late_s = after.utc_s - max(expected_s, resumed_s)
        same = reference[at].waits and after.tree == reference[at + 1].tree
        if same and not -STEP_S <= late_s <= LATE_S:
            self.find(Broken.WAITS, f"{self} {reference[at].waits}: {late_s:.2f} s")

    def compare(self, bench: MissionBench, watch: Watch) -> None:
        reference, found = self.reference, outcome_of(bench, watch, [*self.before, *bench.trace])
        if found.status is not reference.status:
            self.find(Broken.END, f"{self}: {bench.status(PLAN_ID)}")
        if dict(found.questions) != dict(reference.questions):
            self.find(Broken.QUESTIONS, f"{self}: {found.questions}")
        same = _rounds if self.situation.rounds else dict
        if same(found.executed) != same(reference.executed):
            self.find(Broken.COMMANDS, f"{self}: {found.executed} {reference.executed}")
        cells_only = self.situation.parallel
        courses = [_course(each.trace, cells_only) for each in (found, reference)]
        if not self.situation.rounds and courses[0] != courses[1]:
            self.find(Broken.TRACE, f"{self}: {_difference(*courses)}")
        for fault in broken_lifecycles(bench.ledger.reports(1, count=10**6)):
            self.find(Broken.LIFECYCLES, f"{self}: {fault}")
        left = bench.ledger.rows("SELECT state FROM plan_states")
        trees = [decode(text).tree for (text,) in left]
        if len(left) != 1 or any(tree is not None and tree.cells for tree in trees):
            self.find(Broken.LEFT, self)

    def __str__(self) -> str:
        policy = "resume" if self.resumes else "suspend"
        where = ", ".join(kind.value for kind in self.kills)
        return f"{self.situation.name} ({policy}; {where}; change {len(self.before)})"


def _stored(folder: Path) -> tuple[int, Change | None]:
    """Return the restarts of a stored plan, and its tree."""
    database = sqlite3.connect(folder / "ledger.sqlite")
    try:
        rows = database.execute(
            "SELECT state FROM plan_states JOIN plans USING (plan_id) WHERE status IN (2, 3, 4)"
        ).fetchall()
    except sqlite3.Error:
        rows = []
    finally:
        database.close()
    for (text,) in rows:
        state = decode(text)
        if state.tree is not None:
            change = Change(0.0, state.tree.statuses, state.tree.cells)
            return state.restarts, change
        return state.restarts, None
    return MAX_RESTARTS, None


def _rounds(executed: Mapping[str, int]) -> set[str]:
    """Return which commands were executed: the time limit decides how often."""
    return set(executed)


Course = list[Sequence[object]]


def _course(trace: Sequence[Change], cells_only: bool) -> Course:
    """Return the results of each node, and the values of each cell, in their order.

    A wait whose end has passed is not RUNNING in any tick.
    """
    nodes = zip(*(each.statuses for each in trace), strict=True)
    cells = zip(*(each.cells for each in trace), strict=True)
    ended = ([letter for letter in node if letter != "R"] for node in nodes)
    found = [*(() if cells_only else ended), *cells]
    return [[value for value, _ in groupby(each)] for each in found]


def _difference(found: Course, wanted: Course) -> str:
    pairs = enumerate(zip(found, wanted, strict=False))
    return "; ".join(f"{at}: {one} not {other}" for at, (one, other) in pairs if one != other)


def killed_process(
    situation: Situation, resumes: bool, ticks: int, random: Random, folder: Path
) -> Killed:
    """Kill a real process after some ticks, and return what it leaves."""
    receives, sends = os.pipe()
    process = os.fork()
    if process == 0:
        with suppress(BaseException):
            os.close(receives)
            _report_ticks(MissionBench(folder, situation, resumes), sends)
        os._exit(1)
    os.close(sends)
    with os.fdopen(receives, "rb") as stream:
        world = None
        for _ in range(ticks):
            world = pickle.load(stream)
        _pause(random.uniform(0.0, 0.002))
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        with suppress(EOFError, pickle.UnpicklingError):
            while True:
                world = pickle.load(stream)
    assert world is not None
    return Killed(Kill.REAL, files_of(folder), world)


def _pause(duration_s: float) -> None:
    end_s = perf_counter() + duration_s
    while perf_counter() < end_s:
        pass


def _report_ticks(bench: MissionBench, sends: int) -> None:
    with os.fdopen(sends, "wb") as stream:
        while True:
            bench.proceed()
            pickle.dump(_world(bench), stream)
            stream.flush()


def _points(outcome: Outcome, count: int, random: Random) -> Iterator[tuple[Kill, int]]:
    """Yield kills of each kind, spread over the commits and ticks of a run."""
    kinds = [each for each in Kill if each is not Kill.REAL]
    random.shuffle(kinds)
    for number in range(count):
        kind = kinds[number % len(kinds)]
        end = outcome.ticks if kind is Kill.AFTER_TICK else outcome.commits
        yield kind, random.randrange(end)


def kill_missions(
    count: int, seed: int, log: Log, situations: Sequence[Situation] = SITUATIONS
) -> tuple[Findings, Counter[Kill]]:
    """Kill missions at least this often; return what broke, and the kills by kind."""
    findings, kills = Findings(log), Counter[Kill]()
    variants = [(each, resumes) for each in situations for resumes in (True, False)]
    for number, (situation, resumes) in enumerate(variants):
        portion = max(1, round((count - kills.total()) / (len(variants) - number)))
        random = Random(f"{seed} {situation.name} {resumes}")
        kills += _kill_mission(portion, situation, resumes, random, findings.add)
    return findings, kills


def _kill_mission(
    count: int,
    situation: Situation,
    resumes: bool,
    random: Random,
    find: Callable[[Enum, object], None],
) -> Counter[Kill]:
    """Kill one mission at least this often; return the kills by kind."""
    kills = Counter[Kill]()
    reference = undisturbed(situation, resumes, Watch({}, random))
    wanted: dict[tuple[bool, int], list[Kill]] = {}
    for kind, at in _points(reference, count, random):
        wanted.setdefault((kind is not Kill.AFTER_TICK, at), []).append(kind)
    watch = Watch(wanted, random)
    undisturbed(situation, resumes, watch)
    random.shuffle(watch.taken)
    real = sum(random.random() < REAL for _ in range(count))
    with tempfile.TemporaryDirectory() as folder:
        for number in range(real):
            ticks = random.randint(1, max(1, reference.ticks - 2))
            path = Path(folder) / str(number)
            path.mkdir()
            watch.taken.insert(0, killed_process(situation, resumes, ticks, random, path))
    for each in watch.taken:
        if kills.total() >= count:
            break
        run = Continued(situation, resumes, reference, random, find)
        run.run(each)
        kills += run.kills
    return kills


def measure(count: int, seed: int, log: Log) -> list[Figure]:
    """Return what this many kills of missions broke."""
    began_s, cpu_s = perf_counter(), process_time()
    findings, kills = kill_missions(count, seed, log)
    duration_s, used_s = perf_counter() - began_s, process_time() - cpu_s
    beside = f"{len(SITUATIONS)} situations of twelve missions, in lock step, seed {seed}"
    return [
        Figure("plan kills", kills.total(), "", beside, Goal(count, at_least=True)),
        *(Figure(f"plan kills {each.value}", kills[each], "", beside) for each in Kill),
        Figure("plan kills: rate", kills.total() / duration_s, "1/s", f"{used_s:.0f} s of CPU"),
        *findings.figures("plan kills", Broken, beside),
    ]
