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

from executive.commands import Arrival, Command, Identity, Request
from executive.reports import Report


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
