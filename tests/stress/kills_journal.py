"""What a client knows, on disk: a line for each thing that it sent or heard, written at once.

What `write` returned from survives kill -9. A line that a kill cut short is no line.
"""

import json
import os
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self, get_args

from cattrs.preconf.json import make_converter

from executive.commands.catalogue import Arrival, Command, Request
from executive.reports import Identity, Report


@unique
class Answer(Enum):
    """How a SUBMIT was answered."""

    TAKEN = "taken"
    REFUSED = "refused"
    DUPLICATE = "duplicate"


@unique
class Way(Enum):
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
class Heard:
    """A report that came and was not known yet."""

    report: Report
    way: Way


@dataclass(frozen=True, slots=True)
class Fetching:
    """A file whose transfer began, or went on from what was here already.

    Attributes:
        name: what it is to be called on the ground.
        had_octets: how much of it was here.
    """

    path: str
    name: str
    had_octets: int


@dataclass(frozen=True, slots=True)
class Fetched:
    """A file that came to the ground.

    Attributes:
        sha256: of the octets that came, in hexadecimal; the file itself is not kept.
    """

    path: str
    name: str
    sha256: str


Entry = Sent | Answered | Heard | Fetching | Fetched

_KINDS: Final = {kind.__name__: kind for kind in get_args(Entry)}
_REQUESTS: Final = {kind.__name__: kind for kind in get_args(Request)}
_CONVERTER: Final = make_converter()


def _command(raw: dict[str, Any]) -> Command:
    return Command(
        identity=_CONVERTER.structure(raw["identity"], Identity),
        request=_CONVERTER.structure(raw["request"], _REQUESTS[raw["name"]]),
        link=raw["link"],
        created_utc_s=raw["created_utc_s"],
        lifetime_s=raw["lifetime_s"],
        arrival=Arrival(raw["arrival"]),
    )


_UNSTRUCTURE: Final = _CONVERTER.gen_unstructure_attrs_fromdict(Command)
_CONVERTER.register_unstructure_hook(
    Command, lambda command: _UNSTRUCTURE(command) | {"name": command.name}
)
_CONVERTER.register_structure_hook(Command, lambda raw, _: _command(raw))


class Journal:
    """A client's journal.

    Args:
        path: the file; what is in it is read, and more is added.

    Attributes:
        entries: all there is, in the order written.
    """

    def __init__(self, path: Path) -> None:
        """Open or make the file."""
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        octets = path.read_bytes()
        whole = octets[: octets.rfind(b"\n") + 1]
        if len(whole) < len(octets):
            os.ftruncate(self._file, len(whole))
        self.entries: list[Entry] = [_entry(line) for line in whole.splitlines()]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _: type[BaseException] | None, __: BaseException | None, ___: TracebackType | None
    ) -> None:
        os.close(self._file)

    def write(self, entry: Entry) -> None:
        """Add an entry; on disk, as far as the death of this process goes, when this returns."""
        self.entries.append(entry)
        kind = type(entry).__name__
        line = json.dumps({"kind": kind, "entry": _CONVERTER.unstructure(entry)}) + "\n"
        os.write(self._file, line.encode())


def _entry(line: bytes) -> Entry:
    raw = json.loads(line)
    entry: Entry = _CONVERTER.structure(raw["entry"], _KINDS[raw["kind"]])
    return entry


class View:
    """Writes down what is news, and knows what there is to do yet.

    Attributes:
        newest: the highest sequence number heard of.
        whole_to: the highest up to which none is missing.
    """

    def __init__(self, journal: Journal) -> None:
        """Know what the journal knows."""
        self._journal = journal
        self._commands: dict[Identity, Command] = {}
        self._answered: dict[Identity, Answer] = {}
        self._ended: set[Identity] = set()
        self._reports: dict[int, Report] = {}
        self._fetching: Fetching | None = None
        self._fetches = 0
        self.newest = self.whole_to = 0
        for entry in journal.entries:
            self._learn(entry)

    @property
    def next_number(self) -> int:
        """A command number that was not used yet."""
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
    def interrupted(self) -> Fetching | None:
        """The transfer that was not brought to its end."""
        return self._fetching

    @property
    def next_name(self) -> str:
        """What the next file is to be called on the ground."""
        return f"fetched-{self._fetches + 1}"

    def note(self, entry: Sent | Answered | Fetching | Fetched) -> None:
        """Write something down."""
        self._journal.write(entry)
        self._learn(entry)

    def hear(self, report: Report, way: Way) -> None:
        """Write a report down, unless it is known."""
        if self._reports.get(report.sequence) != report:
            entry = Heard(report, way)
            self._journal.write(entry)
            self._learn(entry)

    def _learn(self, entry: Entry) -> None:
        match entry:
            case Sent(command):
                self._commands[command.identity] = command
            case Answered(identity, answer):
                self._answered[identity] = answer
            case Heard(report):
                self._hear(report)
            case Fetching():
                if self._fetching is None:
                    self._fetches += 1
                self._fetching = entry
            case Fetched():
                self._fetching = None

    def _hear(self, report: Report) -> None:
        self._reports[report.sequence] = report
        self.newest = max(self.newest, report.sequence)
        while self.whole_to + 1 in self._reports:
            self.whole_to += 1
        if report.identity is not None and report.stage is not None and report.stage.terminal:
            self._ended.add(report.identity)
