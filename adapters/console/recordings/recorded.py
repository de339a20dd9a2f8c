"""`RecordedRun` converts a recording into the messages that a console receives from a rover."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

from adapters.console.archive import Written
from adapters.console.messages import CommandStatus, LinkKind, Quality, Sample
from adapters.console.rovers import (
    AssetEntry,
    CommandTracker,
    RecordingEntry,
    command_entries,
    foreign_status,
    notification_message,
    parameter_entries,
    plan_progress,
    tree_of,
    zone_entries,
)
from adapters.mrs.spec import DEFINED, POSE_HOUSEKEEPING, ReceivedReport, reported_uncertainty
from adapters.recording import RecordedTree, RecordingError, RunReader, TimedItem, read_timed
from executive.commands import Command, argument_values, declaration_of
from executive.core.recording import (
    CommandDequeued,
    ModeChanged,
    PlanUpdateSent,
    ProcessStart,
    ReportSent,
    TelemetrySent,
    TreeChanged,
)
from executive.history import RunHistory
from executive.history.history_builder import KINDS, HistoryBuilder
from executive.settings import Settings
from executive.values.reports import Report, ReportKind
from trees import TreeSnapshot, leaf_paths

_KINDS: Final = {*KINDS, TelemetrySent, PlanUpdateSent}
TEXT_PERIOD_S: Final = 1.0
"""Minimum interval between two trees that differ in node messages only, s."""
_LINKS: Final = {link.value: link for link in LinkKind}


class RecordedRun:
    """Reads a recording once, from start to end.

    Args:
        path: path of the recording.
        is_wanted: see `RunReader`.

    Attributes:
        rover: name of the recorded asset.

    Raises:
        RecordingError: the file cannot be used as a recording, or holds no run.
    """

    def __init__(self, path: Path, is_wanted: Callable[[], bool]) -> None:
        self._settings = _settings_of(RunReader(path, is_wanted))
        self.rover = self._settings.asset
        self._reader = RunReader(path, is_wanted)
        self._name = ""
        self._history = HistoryBuilder(leaf_paths)
        self._tracker = CommandTracker(self._add_command, lambda: self._utc_s)
        self._found: list[Written] = []
        self._tree: RecordedTree | None = None
        self._mode: ModeChanged | None = None
        self._ticks = 0
        self._tree_differs = self._text_changed = False
        self._tree_utc_s = 0.0
        self._began_utc_s: float | None = None
        self._utc_s = 0.0

    def messages(self, name: str) -> Iterator[Written]:
        """Yield the messages in order of time.

        Args:
            name: asset name of the recording.

        Raises:
            RecordingError: the file cannot be used as a recording, or holds no run.
        """
        self._name = name
        for timed in read_timed(self._reader, _KINDS):
            if timed.utc_s != self._utc_s:
                self._end_moment()
                self._utc_s = timed.utc_s
            if self._began_utc_s is None:
                self._began_utc_s = timed.utc_s
            self._history.put(timed.item)
            self._add_item(timed)
            yield from self._found
            self._found.clear()
        self._end_moment()
        yield from self._found

    def entry(self) -> AssetEntry:
        """Return the dictionary entry of the recording. Call it after all messages were read."""
        settings = self._settings
        assert self._began_utc_s is not None
        return AssetEntry(
            asset=self._name,
            description=f"recording {self._reader.path.name} of {self.rover}",
            version="",
            ranges_known=True,
            parameters=parameter_entries(
                (*DEFINED, *(each.definition for each in POSE_HOUSEKEEPING)), settings
            ),
            commands=command_entries(settings),
            zones=zone_entries(settings),
            footprint=settings.footprint,
            frame=settings.frame,
            recording=RecordingEntry(
                self._reader.path.name,
                self.rover,
                self._began_utc_s,
                self._utc_s,
                self._reader.whole,
                self._reader.damaged,
            ),
        )

    def history(self) -> RunHistory:
        """Return the run history for explanations. Call it after all messages were read."""
        return self._history.history()

    def _add_item(self, timed: TimedItem) -> None:
        match timed.item:
            case ProcessStart(settings=settings):
                self._settings, self._tree = settings, RecordedTree(settings)
                self._tree_differs = True
            case TreeChanged() if self._tree is not None:
                self._ticks += 1
                self._tree_differs |= bool(self._tree.put(timed.item) or timed.item.removed)
                self._text_changed = True
            case ModeChanged():
                self._mode = timed.item
                self._tree_differs = True
            case CommandDequeued(command=command):
                self._register(command)
            case ReportSent(report=report):
                self._report(report)
            case TelemetrySent(values=values):
                for value in values:
                    figure = (value.parameter.value, value.utc_s, value.value)
                    self._found.append(self._sample(*figure))
            case PlanUpdateSent(update=update):
                self._found.append(plan_progress(self._name, update))
            case _:
                pass

    def _end_moment(self) -> None:
        """Add the tree if it has changed.

        Changes of messages alone at most every `TEXT_PERIOD_S`.
        """
        is_due = self._text_changed and self._utc_s - self._tree_utc_s >= TEXT_PERIOD_S
        if self._tree is None or self._mode is None or not (self._tree_differs or is_due):
            return
        self._tree_differs = self._text_changed = False
        self._tree_utc_s = self._utc_s
        mode = self._mode
        nodes = self._tree.nodes()
        snapshot = TreeSnapshot(
            self._ticks, self._utc_s, mode.mode.name, mode.why, nodes, active=mode.active
        )
        self._found.append(tree_of(self._name, LinkKind.RECORDING, snapshot))

    def _register(self, command: Command) -> None:
        identity = command.identity
        if self._tracker.get(str(identity)) is None:
            link, request = _LINKS.get(command.link, LinkKind.RECORDING), command.request
            status = foreign_status(str(identity), self._name, identity, link, self._utc_s)
            name, args = declaration_of(type(request)).name, argument_values(request)
            self._tracker.register(replace(status, name=name, args=args))

    def _add_command(self, command: CommandStatus) -> None:
        """Add the status of a command, unless it is a request without a life cycle."""
        if command.history:
            self._found.append(command)

    def _report(self, report: Report) -> None:
        link = _LINKS.get(report.link or "", LinkKind.RECORDING)
        message = notification_message(self._name, link, ReceivedReport(0, report), report.utc_s)
        if report.identity is not None and report.kind is not ReportKind.LINK:
            name = self._tracker.on_notification(message, report.identity)
            message = replace(message, command=name)
        self._found.append(message)
        for key, figure in reported_uncertainty(report).items():
            self._found.append(self._sample(key, report.utc_s, figure))

    def _sample(self, key: str, utc_s: float, figure: float | None) -> Sample:
        quality = Quality.INVALID if figure is None else Quality.GOOD
        return Sample(self._name, key, LinkKind.RECORDING, utc_s, utc_s, figure, quality)


def _settings_of(reader: RunReader) -> Settings:
    for timed in read_timed(reader, ()):
        if isinstance(timed.item, ProcessStart):
            return timed.item.settings
    raise RecordingError(f"{reader.path}: the recording names no rover")
