"""Replays a recording: the same inputs through the core, and whether it decides the same."""

import json
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import zip_longest
from math import inf
from pathlib import Path
from typing import Final, assert_never

from adapters.recording.messages import DECISIONS, LIFE, TRUTH, decode, encode, topic_of
from adapters.recording.run_file import RecordedMessage, RecordingError, RunReader
from executive.authority import AuthorityAsked
from executive.commands import Stop
from executive.geometry import Velocity
from executive.inbox import Question, Submission
from executive.motion import Plan, Problem, SharedSolver
from executive.ports import CameraIntent, MotionRover, VelocityRover, WholeMotion
from executive.record import Ledger, Synchronous
from executive.recorded_executive import RecordedExecutive, RecordedInbox, with_recorded_answer
from executive.recording import (
    Call,
    Called,
    Entry,
    GroundHeard,
    Input,
    Item,
    Life,
    MadeSafe,
    Noticed,
    Observed,
    Served,
    SolverAnswered,
    SolverBusy,
    StopWaited,
    is_within,
)
from executive.settings import LocomotionKind
from trees import RoverTree

NOTHING: Final = "nothing"
LONGEST: Final = 200
"""Characters that are shown of a decision."""


@dataclass(slots=True)
class RecordedEntry:
    """An entry of the core, with what came in during it and what was decided in it."""

    entry: Entry
    inputs: list[Input | Entry] = field(default_factory=list)
    decisions: list[RecordedMessage] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Difference:
    """The first decision that is another one.

    Attributes:
        number: of the entry in the recording, from 1.
        entry: its topic.
        time_s: of the entry, since the first.
        recorded, replayed: the decision; None where there is none.
    """

    number: int
    entry: str
    time_s: float
    recorded: RecordedMessage | None
    replayed: RecordedMessage | None

    @property
    def lines(self) -> tuple[str, ...]:
        """Both decisions, a line each; of two of one kind, a line for each part that differs."""
        then, now = self.recorded, self.replayed
        if then is not None and now is not None and then.topic == now.topic:
            before, after = dict(_parts(json.loads(then.data))), dict(_parts(json.loads(now.data)))
            return tuple(
                f"{then.topic.name} {part}: recorded {_short(before.get(part, NOTHING))},"
                f" replayed {_short(after.get(part, NOTHING))}"
                for part in {**before, **after}
                if before.get(part, NOTHING) != after.get(part, NOTHING)
            )
        return f"recorded: {_told(then)}", f"replayed: {_told(now)}"


def _parts(value: object, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield the numbers and texts in plain data, with their places."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _parts(part, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _parts(part, f"{path}[{index}]")
    else:
        yield path, json.dumps(value, ensure_ascii=False)


def _told(message: RecordedMessage | None) -> str:
    return NOTHING if message is None else _short(f"{message.topic.name} {message.data.decode()}")


def _short(text: str) -> str:
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"


@dataclass(frozen=True, slots=True)
class Replayed:
    """What a replay came to.

    Attributes:
        lives: how often the executive started.
        entries, ticks, decisions: how many were compared.
        duration_s: from the first entry to the last.
        whole: whether the recording was closed in good order.
        difference: the first; None where there is none.
    """

    lives: int
    entries: int
    ticks: int
    decisions: int
    duration_s: float
    whole: bool
    difference: Difference | None


def replay(path: Path) -> Replayed:
    """Replay a recording up to the first difference.

    Raises:
        RecordingError: the file cannot be used as a recording.
    """
    reader = RunReader(path)
    lives = entries = ticks = decisions = 0
    began_s = time_s = 0.0
    difference = None
    with tempfile.TemporaryDirectory(prefix="rover-replay-") as folder:
        core = None
        for each in _entries(reader, path):
            if isinstance(each, Life):
                lives += 1
                place = Path(folder, str(lives))
                core = _Core(each, place)
                continue
            if core is None:
                raise RecordingError(f"{path}: begins in the middle, without {LIFE}")
            began_s = each.entry.utc_s if entries == 0 else began_s
            time_s = each.entry.utc_s - began_s
            entries += 1
            ticks += isinstance(each.entry, Called) and each.entry.call is Call.TICK
            decisions += len(each.decisions)
            found = core.differs(each)
            if found is not None:
                name = topic_of(each.entry).name
                difference = Difference(entries, name, time_s, *found)
                break
        if core is not None:
            core.end()
    if lives == 0:
        raise RecordingError(f"{path}: holds no run")
    return Replayed(lives, entries, ticks, decisions, time_s, reader.whole, difference)


def _entries(reader: RunReader, path: Path) -> Iterator[Life | RecordedEntry]:
    """Yield lives and entries; the last entry of a file that was not closed may lack its end."""
    current: RecordedEntry | None = None
    for message in reader.messages():
        if message.topic.name == TRUTH:
            continue
        if message.topic.name.startswith(DECISIONS):
            if current is not None:
                current.decisions.append(message)
            continue
        item = _decoded(message, path)
        if isinstance(item, Input) or is_within(item):
            if current is not None:
                current.inputs.append(item)
            continue
        if current is not None:
            yield current
        if isinstance(item, Life):
            current = None
            yield item
        else:
            current = RecordedEntry(item)
    if current is not None and reader.whole:
        yield current


def _decoded(message: RecordedMessage, path: Path) -> Life | Entry | Input:
    try:
        item: Life | Entry | Input = decode(message.topic, message.data)
    except Exception as error:  # cattrs raises groups of many kinds
        text = f"{path}: a message of {message.topic.name} cannot be read: {error}"
        raise RecordingError(text) from error
    return item


class _Clock:
    """Shows the time of the recording."""

    def __init__(self) -> None:
        self.entry: Entry = Called(0.0, 0.0, Call.START)

    def now_s(self) -> float:
        return self.entry.now_s

    def utc_s(self) -> float:
        return self.entry.utc_s


class _Tape:
    """Keeps the decisions of the entry under way."""

    def __init__(self) -> None:
        self.decisions: list[RecordedMessage] = []

    def put(self, item: Item) -> None:
        topic = topic_of(item)
        if topic.name.startswith(DECISIONS):
            self.decisions.append(RecordedMessage(topic, encode(item)))


Scripted = Served | AuthorityAsked | Noticed | MadeSafe
"""What is taken from the inbox: commands, and what questions of other threads did."""


class _ScriptedInbox(RecordedInbox):
    """Hands over the commands and the questions of the recording, in its order.

    Attributes:
        core: whom the questions ask.
    """

    def __init__(self, tape: _Tape) -> None:
        super().__init__(tape)
        self._decisions = tape
        self._script: list[Scripted] = []
        self._overtaken: set[int] = set()
        self._taken = 0
        self._stop_came = inf
        self.core: RecordedExecutive | None = None

    def load(self, inputs: Sequence[Input | Entry]) -> None:
        """Take what comes in during the next entry."""
        self._script = [each for each in inputs if isinstance(each, Scripted)]
        came = (each.looks for each in inputs if isinstance(each, StopWaited))
        self._stop_came = next(came, inf)

    @property
    def stop_waits(self) -> bool:
        self.looks += 1
        return self.looks > self._stop_came

    @property
    def stops_now(self) -> int:
        flags = [
            isinstance(e, Served) and isinstance(e.command.request, Stop) for e in self._script
        ]
        return flags.index(False) if False in flags else len(flags)

    @property
    def items_now(self) -> int:
        return len(self._script) - self.stops_now

    def take_stop(self) -> Submission:
        return self._submission(self._script.pop(0))

    def take(self) -> Submission | Question:
        item = self._script.pop(0)
        return self._submission(item) if isinstance(item, Served) else partial(self._ask, item)

    def overtaken(self, submission: Submission) -> bool:
        return submission.arrival in self._overtaken

    def _ask(self, item: Scripted) -> None:
        core = self.core
        assert core is not None
        match item:
            case AuthorityAsked():
                core.ask_authority(item)
            case Noticed(severity=severity, text=text, figures=figures, kind=kind):
                core.event(severity, text, figures, kind)
            case MadeSafe(danger=danger):
                core.make_safe(danger)
            case Served():
                raise AssertionError(item)
            case _:
                assert_never(item)

    def _submission(self, served: Scripted) -> Submission:
        assert isinstance(served, Served)
        self._taken += 1
        if served.overtaken:
            self._overtaken.add(self._taken)
        submission = Submission(self._taken, served.command, lambda _: None, lambda: None)
        return with_recorded_answer(submission, self._decisions)


class _ScriptedSolver:
    """Answers as in the recording."""

    def __init__(self, lead_ticks: int) -> None:
        self.lead_ticks = lead_ticks
        self._plans: list[Plan | None] = []
        self._busy: list[bool] = []

    def load(self, inputs: Sequence[Input | Entry]) -> None:
        """Take what is answered in the next entry."""
        self._plans = [each.plan for each in inputs if isinstance(each, SolverAnswered)]
        self._busy = [each.busy for each in inputs if isinstance(each, SolverBusy)]

    @property
    def busy(self) -> bool:
        return self._busy.pop(0) if self._busy else False

    def ask(self, problem: Problem) -> None:
        """Leave it to the recording."""

    def answer(self) -> Plan | None:
        return self._plans.pop(0) if self._plans else None

    def beside(self, apart: bool = False) -> "_ScriptedSolver":
        """Return itself: what all were answered is recorded in one order."""
        return self


class _StillVideo:
    def __init__(self) -> None:
        self.on = False

    def switch(self, on: bool) -> None:
        self.on = on


class _StillRover:
    def point_camera(self, wanted: CameraIntent) -> None: ...

    def request_frame(self) -> None: ...

    def emergency_stop(self) -> None: ...

    def lock(self, held: bool) -> None: ...


class _StillVelocityRover(_StillRover):
    def drive(self, velocity: Velocity) -> None: ...


class _StillMotionRover(_StillRover):
    def carry_out(self, motion: WholeMotion) -> None: ...

    def halt(self) -> None: ...


Pair = tuple[RecordedMessage | None, RecordedMessage | None]


class _Core:
    """The executive of one life, in a folder of its own."""

    def __init__(self, life: Life, folder: Path) -> None:
        self._life = life
        self._folder = folder
        self._clock = _Clock()
        self._tape = _Tape()
        self._inbox = _ScriptedInbox(self._tape)
        self._solver: _ScriptedSolver | None = None
        if life.solver_lead_ticks is not None:
            self._solver = _ScriptedSolver(life.solver_lead_ticks)
        self._executive: RecordedExecutive | None = None
        (folder / "files").mkdir(parents=True)
        (folder / "ledger.sqlite").write_bytes(life.ledger)
        if life.latch:
            (folder / "ledger.stop").write_bytes(life.latch)
        for each in life.files:
            place = folder / "files" / each.path
            place.parent.mkdir(parents=True, exist_ok=True)
            with place.open("wb") as file:
                file.truncate(each.size_octets)

    def differs(self, recorded: RecordedEntry) -> Pair | None:
        """Run an entry; return the first decision that is another one, as recorded and now."""
        self._clock.entry = recorded.entry
        self._tape.decisions = []
        self._inbox.load(recorded.inputs)
        if self._solver is not None:
            self._solver.load(recorded.inputs)
        self._enter(recorded)
        pairs = zip_longest(recorded.decisions, self._tape.decisions)
        return next((pair for pair in pairs if pair[0] != pair[1]), None)

    def end(self) -> None:
        """End it as a crash would."""
        if self._executive is not None:
            self._executive.abandon()

    def _enter(self, recorded: RecordedEntry) -> None:
        entry = recorded.entry
        if isinstance(entry, Called) and entry.call is Call.START:
            self._executive = self._start()
            return
        executive = self._executive
        if executive is None:
            raise RecordingError(f"{topic_of(entry).name} stands before /in/start")
        if any(isinstance(each, GroundHeard) for each in recorded.inputs):
            executive.ground.hear()
        match entry:
            case Observed(fact=fact):
                executive.observe(fact)
            case Noticed(severity=severity, text=text, figures=figures, kind=kind):
                executive.event(severity, text, figures, kind)
            case MadeSafe(danger=danger):
                executive.make_safe(danger)
            case Called(call=Call.TURN):
                executive.turn()
            case Called(call=Call.TICK):
                executive.tick()
            case Called():
                executive.close()
                self._executive = None

    def _start(self) -> RecordedExecutive:
        settings = self._life.settings
        by_velocity = settings.locomotion is LocomotionKind.VELOCITY
        rover: VelocityRover | MotionRover = (
            _StillVelocityRover() if by_velocity else _StillMotionRover()
        )
        solver: SharedSolver | None = self._solver
        executive = RecordedExecutive(
            self._tape,
            settings=settings,
            clock=self._clock,
            rover=rover,
            ledger=Ledger(self._folder / "ledger.sqlite", Synchronous.NORMAL),
            files=self._folder / "files",
            downlinks=[],
            build_tree=RoverTree,
            video=None if settings.video is None else _StillVideo(),
            solver=solver,
            inbox=self._inbox,
        )
        self._inbox.core = executive
        return executive
