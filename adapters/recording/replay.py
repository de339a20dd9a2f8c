"""`replay` runs the core on the inputs of a recording, and compares its decisions."""

import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Final

from adapters.recording.container import RecordingError
from adapters.recording.first_decision import NOTHING, FirstDecision, differing
from adapters.recording.messages import START, topic_of
from adapters.recording.replayed import RecordedEntry, ReplayedCore, read_entries
from adapters.recording.run_file import RecordedMessage, RunReader
from executive.commands import declaration_of
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    ModeChanged,
    ProcessStart,
    ReportSent,
    SimulationItem,
    TreeChanged,
    TreeNodeState,
)
from executive.settings import Settings
from executive.values.reports import Identity, Report
from trees import RoverTree, TreeNodeSnapshot

TEXTS: Final = "only texts or figures differ"
MAX_SHOWN_LENGTH: Final = 200
"""Maximum characters shown of a decision."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first decision that differs.

    Attributes:
        number: number of the entry in the recording, from 1.
        time_s: time of the entry since the first.
        recorded, replayed: the decisions; None if there is none.
        raised: exception of the core as text; empty if there is none.
        tree: tree of the replay after the entry.
        then: recorded state of the nodes that differ, by their paths.
    """

    number: int
    entry: str
    time_s: float
    recorded: RecordedMessage | None
    replayed: RecordedMessage | None
    raised: str
    tree: tuple[TreeNodeSnapshot, ...]
    then: Mapping[str, str]

    @property
    def lines(self) -> tuple[str, ...]:
        """Both decisions, a line each; for two of one type, a line for each field that differs."""
        then, now = self.recorded, self.replayed
        if self.raised:
            return f"recorded: {_decision_line(then)}", f"replayed: {self.raised}"
        if then is not None and now is not None and then.topic == now.topic:
            before, after = dict(_parts(json.loads(then.data))), dict(_parts(json.loads(now.data)))
            return tuple(
                f"{then.topic.name} {part}: recorded {_short(before.get(part, NOTHING))},"
                f" replayed {_short(after.get(part, NOTHING))}"
                for part in {**before, **after}
                if before.get(part, NOTHING) != after.get(part, NOTHING)
            )
        return f"recorded: {_decision_line(then)}", f"replayed: {_decision_line(now)}"


def _parts(value: object, path: str = "") -> Iterator[tuple[str, str]]:
    """Yield path and JSON text of each number and text in plain data."""
    if isinstance(value, dict):
        for key, part in value.items():
            yield from _parts(part, f"{path}.{key}" if path else key)
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _parts(part, f"{path}[{index}]")
    else:
        yield path, json.dumps(value, ensure_ascii=False)


def _decision_line(message: RecordedMessage | None) -> str:
    return NOTHING if message is None else _short(f"{message.topic.name} {message.data.decode()}")


def _short(text: str) -> str:
    return text if len(text) <= MAX_SHOWN_LENGTH else f"{text[:MAX_SHOWN_LENGTH]}…"


@dataclass(frozen=True, slots=True)
class ChangedReport:
    """A report that is only in the recording, or only in its replay.

    Attributes:
        time_s: time since the first entry.
        recorded: whether it is in the recording.
    """

    time_s: float
    recorded: bool
    report: Report


@dataclass(frozen=True, slots=True)
class ReplayDecision:
    """The first different decision of a replay.

    Attributes:
        command: name of the command that was executing, or that it is about; empty without one.
        entry: number of the entry in the recording, from 1.
        time_s: time since the first entry.
        decision: the decision; None if only texts or figures differ.
    """

    command: str
    entry: int
    time_s: float
    decision: FirstDecision | None

    @property
    def group(self) -> tuple[str, str, str]:
        """Command, replayed and recorded decision, without figures: equal for equal changes."""
        found = self.decision
        return ("", TEXTS, "") if found is None else (self.command, *found.group)


@dataclass(frozen=True, slots=True)
class ReplayResult:
    """Result of a replay.

    Attributes:
        starts: number of starts of the executive.
        entries, ticks, decisions: numbers that were compared.
        duration_s: time from the first entry to the last.
        whole: whether the recording was closed properly.
        difference: the first difference, or None.
        reports: reports that differ, if other settings were given.
        decision: the first different decision, if it was to be found; a difference of texts or
            figures if there is no other.
    """

    starts: int
    entries: int
    ticks: int
    decisions: int
    duration_s: float
    whole: bool
    difference: Difference | None
    reports: tuple[ChangedReport, ...]
    decision: ReplayDecision | None = None


def replay(path: Path, settings: Settings | None = None, to_decision: bool = False) -> ReplayResult:
    """Replay a recording up to the first difference.

    Args:
        path: first file of the recording.
        settings: settings to replace those of the run. The replay then continues to the end,
            although recorded sensors do not follow commands that differ.
        to_decision: whether to end at the first difference that is more than texts or figures.

    Raises:
        RecordingError: the file cannot be used as a recording, or is of another asset.
    """
    reader = RunReader(path)
    histories = entries = ticks = decisions = 0
    began_s = time_s = 0.0
    difference = None
    reports: list[ChangedReport] = []
    decision = None
    with tempfile.TemporaryDirectory(prefix="rover-replay-") as folder:
        core = None
        for each in read_entries(reader):
            if isinstance(each, SimulationItem):
                continue
            if isinstance(each, ProcessStart):
                histories += 1
                try:
                    core = _ComparedCore(
                        _with(each, settings, path), Path(folder, str(histories)), reader
                    )
                except (OSError, ValueError) as error:
                    raise RecordingError(f"{path}: cannot create its files: {error}") from error
                continue
            if core is None:
                raise RecordingError(f"{path}: begins in the middle, without {START}")
            began_s = each.entry.utc_s if entries == 0 else began_s
            time_s = each.entry.utc_s - began_s
            entries += 1
            ticks += isinstance(each.entry, CoreCalled) and each.entry.call is CoreCall.TICK
            decisions += len(each.decisions)
            core.enter(each)
            if settings is not None:
                reports += _other_reports(reader, each.decisions, core.decisions, time_s)
            if difference is None:
                difference = core.difference(each, entries, time_s)
            if to_decision and difference is not None:
                found = core.decision(each, entries, time_s)
                decision = found if found.decision else decision or found
                is_last = found.decision is not None
            else:
                is_last = difference is not None and settings is None and not to_decision
            if core.raised or is_last:
                break
        if core is not None:
            core.end()
    if histories == 0:
        raise RecordingError(f"{path}: contains no run")
    return ReplayResult(
        histories,
        entries,
        ticks,
        decisions,
        time_s,
        reader.whole or bool(decision and decision.decision),
        difference,
        tuple(reports),
        decision,
    )


def _with(lifecycle: ProcessStart, settings: Settings | None, path: Path) -> ProcessStart:
    if settings is None:
        return lifecycle
    if settings.asset != lifecycle.settings.asset:
        raise RecordingError(f"{path}: is of {lifecycle.settings.asset}, not of {settings.asset}")
    return replace(lifecycle, settings=settings)


def _other_reports(
    reader: RunReader,
    recorded: Sequence[RecordedMessage],
    replayed: Sequence[RecordedMessage],
    time_s: float,
) -> Iterator[ChangedReport]:
    then, now = _reports(reader, recorded), _reports(reader, replayed)
    yield from (ChangedReport(time_s, True, then[key]) for key in then if key not in now)
    yield from (ChangedReport(time_s, False, now[key]) for key in now if key not in then)


def _reports(
    reader: RunReader, decisions: Sequence[RecordedMessage]
) -> dict[tuple[object, ...], Report]:
    """Return the reports by identity, stage, reason and text, ignoring numbers and figures."""
    found = (reader.decoded(each) for each in decisions if each.topic.kind is ReportSent)
    reports = (each.report for each in found)
    return {(each.identity, each.stage, each.reason, each.text): each for each in reports}


class _ComparedCore(ReplayedCore):
    """A replayed core with the comparison of its decisions."""

    def __init__(self, lifecycle: ProcessStart, folder: Path, reader: RunReader) -> None:
        super().__init__(lifecycle, folder)
        self._reader = reader
        self._states: dict[str, TreeNodeState] = {}
        self._commands: dict[Identity, str] = {}
        self._active: Identity | None = None

    def enter(self, recorded: RecordedEntry) -> None:
        """Run an entry, and follow the recorded tree and its commands."""
        super().enter(recorded)
        for each in recorded.inputs:
            if isinstance(each, CommandDequeued):
                name = declaration_of(type(each.command.request)).name
                self._commands[each.command.identity] = name
        for message in recorded.decisions:
            if message.topic.kind is ModeChanged:
                self._active = self._reader.decoded(message).active
            if message.topic.kind is TreeChanged:
                changed: TreeChanged = self._reader.decoded(message)
                self._states |= {each.path: each for each in changed.nodes}
                for path in changed.removed:
                    self._states.pop(path, None)

    def difference(self, recorded: RecordedEntry, number: int, time_s: float) -> Difference | None:
        """Return the first decision of the entry that differs, or None."""
        pairs = zip_longest(recorded.decisions, self.decisions)
        then, now = next((pair for pair in pairs if pair[0] != pair[1]), (None, None))
        if then is None and now is None and not self.raised:
            return None
        tree: tuple[TreeNodeSnapshot, ...] = ()
        if self.executive is not None and isinstance(self.executive.tree, RoverTree):
            tree = self.executive.tree.nodes()
        name = topic_of(recorded.entry).name
        return Difference(number, name, time_s, then, now, self.raised, tree, self._then(tree))

    def decision(self, recorded: RecordedEntry, number: int, time_s: float) -> ReplayDecision:
        """Return how the decisions of the entry differ."""
        found = differing(recorded.decisions, self.decisions, self._reader.decoded, self.raised)
        about = (found and found.identity) or self._active
        command = self._commands.get(about, "") if found and about else ""
        return ReplayDecision(command, number, time_s, found)

    def _then(self, tree: Sequence[TreeNodeSnapshot]) -> dict[str, str]:
        """Return the recorded state of each node that differs."""
        states: dict[str, str] = {}
        for node in tree if self._states else ():
            state = self._states.get(node.path)
            if state is None:
                states[node.path] = "not in the recording"
            elif (state.status, state.message) != (node.status.name, node.message):
                states[node.path] = f"recorded: {state.status} {state.message}".rstrip()
        return states
