"""`ReplayedCore` runs the core on recorded entries; `read_entries` reads them."""

import traceback
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, get_args

from adapters.recording.container import RecordingError
from adapters.recording.messages import DECISIONS, topic_of
from adapters.recording.replayed.ports import (
    Decisions,
    NullRover,
    NullVideo,
    RecordedClock,
    ReplayInbox,
    ReplayLedger,
    ReplaySolver,
    notice,
)
from adapters.recording.run_file import RecordedMessage, RunReader
from executive.core.recording import (
    CoreCall,
    CoreCalled,
    EmergencyStopped,
    Entry,
    EventReported,
    FactObserved,
    GroundContact,
    Input,
    ProcessStart,
    RecordingSink,
    RecordingTee,
    SafeModeEntered,
    SimulationItem,
    is_within,
)
from executive.core.runner import Executive
from executive.motion import SharedSolver
from executive.values.ports import DelegatedMotionRover, Downlink, VelocityRover
from trees import RoverTree

_SIMULATION: Final = get_args(SimulationItem)


@dataclass(slots=True)
class RecordedEntry:
    """An entry of the core, with the inputs and the decisions during it."""

    entry: Entry
    inputs: list[Input | Entry] = field(default_factory=list)
    decisions: list[RecordedMessage] = field(default_factory=list)


def read_entries(reader: RunReader) -> Iterator[ProcessStart | RecordedEntry | SimulationItem]:
    """Yield starts and entries; omit a truncated file's last entry, which may lack items.

    Items of a simulation follow the entry that they were recorded in.
    """
    simulated: list[SimulationItem] = []
    current: RecordedEntry | None = None
    for message in reader.messages():
        if message.topic.kind in _SIMULATION:
            simulated.append(reader.decoded(message))
            continue
        if message.topic.name.startswith(DECISIONS):
            if current is not None:
                current.decisions.append(message)
            continue
        item: ProcessStart | Entry | Input = reader.decoded(message)
        if isinstance(item, Input) or is_within(item):
            if current is not None:
                current.inputs.append(item)
            continue
        if current is not None:
            yield current
        yield from simulated
        simulated = []
        if isinstance(item, ProcessStart):
            current = None
            yield item
        else:
            current = RecordedEntry(item)
    if current is not None and reader.whole:
        yield current
    yield from simulated


class ReplayedCore:
    """Executive of one recorded start, in a folder of its own.

    Args:
        lifecycle: the start.
        folder: new folder of its files.
        rover: receives its commands; None for a rover without effect.
        solver: solves its trajectory problems; None for the recorded results.
        tape: receives a recording of it; None for none.
        downlinks: receivers of its reports and telemetry.

    Attributes:
        executive: the executive; None before the first entry and after the last.
        clock: its clock.
        decisions: decisions of the last entry.
        raised: exception of the last entry as text; empty if there was none.

    Raises:
        OSError, ValueError: its files cannot be created.
    """

    def __init__(
        self,
        lifecycle: ProcessStart,
        folder: Path,
        rover: VelocityRover | DelegatedMotionRover | None = None,
        solver: SharedSolver | None = None,
        tape: RecordingSink | None = None,
        downlinks: Sequence[Downlink] = (),
    ) -> None:
        self.executive: Executive | None = None
        self.raised = ""
        self._start_item = lifecycle
        self._folder = folder
        self._rover = rover or NullRover()
        self._downlinks = downlinks
        self.clock = RecordedClock()
        self._tape = Decisions()
        self._inbox = ReplayInbox()
        lead_ticks = lifecycle.solver_lead_ticks
        self._scripted_solver = None if lead_ticks is None else ReplaySolver(lead_ticks)
        self._solver = solver or self._scripted_solver
        self._sink = self._tape if tape is None else RecordingTee(self._tape, tape)
        self._ledger: ReplayLedger | None = None
        write_files(lifecycle, folder)

    @property
    def decisions(self) -> Sequence[RecordedMessage]:
        """Decisions of the last entry."""
        return self._tape.decisions

    def enter(self, recorded: RecordedEntry) -> None:
        """Run an entry."""
        self.clock.entry = recorded.entry
        self._tape.decisions = []
        for scripted in (self._inbox, self._ledger, self._scripted_solver):
            if scripted is not None:
                scripted.load(recorded.inputs)
        try:
            self._enter(recorded)
        except RecordingError:
            raise
        except Exception as error:  # raised by changed code
            at = traceback.extract_tb(error.__traceback__)[-1]
            self.raised = f"{type(error).__name__}: {error} (line {at.lineno} of {at.filename})"

    def continue_live(self, solver: SharedSolver | None) -> Executive:
        """Return the executive, from now on with commands of its inbox and results of a solver.

        The owner of `clock` sets the time.

        Raises:
            RecordingError: there is no executive.
        """
        if self.executive is None:
            raise RecordingError("no executive ran at that time")
        for scripted in (self._inbox, self._ledger):
            if scripted is not None:
                scripted.load(())
        if self._scripted_solver is not None and solver is not None:
            self._scripted_solver.continue_live(solver)
        return self.executive

    def end(self) -> None:
        """End it like a crash."""
        if self.executive is not None:
            self.executive.simulate_crash()

    def _enter(self, recorded: RecordedEntry) -> None:
        entry = recorded.entry
        if isinstance(entry, CoreCalled) and entry.call is CoreCall.START:
            self.executive = self._start()
        executive = self.executive
        if executive is None:
            raise RecordingError(f"{topic_of(entry).name} precedes /in/start")
        if any(isinstance(each, GroundContact) for each in recorded.inputs):
            executive.ground.record_contact()
        match entry:
            case FactObserved(fact=fact):
                executive.observe(fact)
            case EventReported() | SafeModeEntered():
                notice(executive, entry)
            case CoreCalled(call=CoreCall.START):
                pass
            case CoreCalled(call=CoreCall.SERVE):
                executive.serve_inbox()
            case CoreCalled(call=CoreCall.TICK):
                executive.tick()
            case CoreCalled():
                executive.close()
                self.executive = None
        if any(isinstance(each, EmergencyStopped) for each in recorded.inputs):
            executive.emergency_stop()  # another thread called it, at the latest now

    def _start(self) -> Executive:
        settings = self._start_item.settings
        self._ledger = ReplayLedger(self._folder / "ledger.sqlite")
        executive = Executive(
            settings=settings,
            clock=self.clock,
            rover=self._rover,
            ledger=self._ledger,
            files=self._folder / "files",
            downlinks=self._downlinks,
            build_tree=RoverTree,
            video=NullVideo() if self._start_item.video else None,
            solver=self._solver,
            inbox=self._inbox,
            tape=self._sink,
        )
        self._inbox.core = executive
        return executive


def write_files(lifecycle: ProcessStart, folder: Path) -> None:
    """Write ledger, stop latch and files of a start into a folder.

    Raises:
        OSError, ValueError: a file cannot be created.
    """
    (folder / "files").mkdir(parents=True, exist_ok=True)
    (folder / "ledger.sqlite").write_bytes(lifecycle.ledger)
    if lifecycle.latch:
        (folder / "ledger.stop").write_bytes(lifecycle.latch)
    for each in lifecycle.files:
        target = (folder / "files" / each.path).resolve()
        if not target.is_relative_to((folder / "files").resolve()):
            raise ValueError(f"{each.path} is outside of its folder")
        target.parent.mkdir(parents=True, exist_ok=True)
        with target.open("wb") as file:
            file.truncate(each.size_octets)
