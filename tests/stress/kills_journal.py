"""What a client knows of the rover and of its own commands, in a journal that outlives it."""

from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from typing import Any, Final, get_args

from cattrs.preconf.json import make_converter

from executive.commands.catalogue import Command, Request
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import Identity, Report
from tests.stress.journal import Journal, read_journal


@unique
class Answer(Enum):
    """How a SUBMIT was answered."""

    TAKEN = "taken"
    REFUSED = "refused"
    DUPLICATE = "duplicate"


@unique
class Route(Enum):
    """How a report came."""

    BROKER = "broker"
    BROKER_MEMORY = "asked of the broker"
    LEDGER = "asked of the rover"


@dataclass(frozen=True, slots=True)
class Sent:
    """A command that is about to be sent, for the first time or again."""

    command: Command


@dataclass(frozen=True, slots=True)
class Answered:
    """A command that was acknowledged, one way or the other."""

    identity: Identity
    answer: Answer


@dataclass(frozen=True, slots=True)
class Received:
    """A report that came and was not known yet."""

    report: Report
    route: Route


@dataclass(frozen=True, slots=True)
class Fetching:
    """A file whose transfer began, or went on from the octets that were here already."""

    path: str
    name: str
    had_octets: int


@dataclass(frozen=True, slots=True)
class Fetched:
    """A file that came to the ground; the file itself is not kept."""

    path: str
    name: str
    sha256: str


Entry = Sent | Answered | Received | Fetching | Fetched
_KINDS: Final = {kind.__name__: kind for kind in get_args(Entry)}
_REQUESTS: Final = {kind.__name__: kind for kind in get_args(Request)}
_CONVERTER: Final = make_converter()
_CONVERTER.register_unstructure_hook(
    Request, lambda request: [type(request).__name__, _CONVERTER.unstructure(request)]
)
_CONVERTER.register_structure_hook_func(
    lambda kind: kind == (Reason | UnknownReason | None),
    lambda number, _: None if number is None else Reason(number),
)
_CONVERTER.register_structure_hook(
    Request, lambda raw, _: _CONVERTER.structure(raw[1], _REQUESTS[raw[0]])
)


def read_entries(path: Path) -> list[Entry]:
    return list(map(_entry, read_journal(path)))


def _entry(row: list[Any]) -> Entry:
    entry: Entry = _CONVERTER.structure(row[1], _KINDS[row[0]])
    return entry


class View:
    """Writes down what is news, and knows what there is to do yet.

    Attributes:
        entries: how many there were when it was opened.
        newest: the highest sequence number heard of.
        complete_to: the highest up to which no report is missing.
        interrupted: the transfer that was not brought to its end.
    """

    def __init__(self, path: Path) -> None:
        self._journal = Journal(path)
        self._commands: dict[Identity, Command] = {}
        self._answered: set[Identity] = set()
        self._ended: set[Identity] = set()
        self._reports: dict[int, Report] = {}
        self._fetches = 0
        self.interrupted: Fetching | None = None
        self.newest = self.complete_to = 0
        self.entries = len(self._journal.rows)
        for row in self._journal.rows:
            self._learn(_entry(row))

    @property
    def next_number(self) -> int:
        return 1 + max((each.command_id for each in self._commands), default=0)

    @property
    def commands(self) -> list[Command]:
        """All that were sent, in the order of the first time."""
        return list(self._commands.values())

    @property
    def unanswered(self) -> list[Command]:
        """What was sent and not acknowledged, in the order sent."""
        return [self._commands[each] for each in self._commands if each not in self._answered]

    @property
    def living(self) -> list[Identity]:
        """The commands whose end is not known."""
        return [each for each in self._commands if each not in self._ended]

    @property
    def next_name(self) -> str:
        return f"fetched-{self._fetches + 1}"

    def note(self, entry: Entry) -> None:
        self._journal.write(type(entry).__name__, _CONVERTER.unstructure(entry))
        self._learn(entry)

    def receive(self, report: Report, route: Route) -> None:
        """Write a report down, unless it is known."""
        if self._reports.get(report.sequence) != report:
            self.note(Received(report, route))

    def _learn(self, entry: Entry) -> None:
        match entry:
            case Sent(command):
                self._commands[command.identity] = command
            case Answered(identity):
                self._answered.add(identity)
            case Received(report):
                self._learn_report(report)
            case Fetching():
                self._fetches += self.interrupted is None
                self.interrupted = entry
            case Fetched():
                self.interrupted = None

    def _learn_report(self, report: Report) -> None:
        self._reports[report.sequence] = report
        self.newest = max(self.newest, report.sequence)
        while self.complete_to + 1 in self._reports:
            self.complete_to += 1
        if report.identity is not None and report.stage is not None and report.stage.terminal:
            self._ended.add(report.identity)
