"""Requests of the core as MOPS messages, and back, as `config/mops/dictionary.yaml` spells them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, get_args

from adapters.mops.message import Message, MopsError
from adapters.mops.values import made_of, names_of, values_of
from executive.commands import Identity, Request
from executive.parameters import Parameter
from executive.settings import SettingsError, config_folder, read_yaml


@dataclass(frozen=True, slots=True)
class Entry:
    """How one command is spelled.

    Attributes:
        code: the message's code.
        command: the message's name.
        inputs: names of its values; they must be those of the request, in their order.
    """

    code: int
    command: str
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TelemetryEntry:
    """How telemetry is spelled: the parameters in their order."""

    code: int
    command: str
    outputs: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class OtherEntry:
    """How something else is spelled that has values of its own."""

    code: int
    command: str


@dataclass(frozen=True, slots=True)
class Spelling:
    """The file."""

    commands: Mapping[str, Entry]
    telemetry: TelemetryEntry
    event: OtherEntry
    link: OtherEntry


_KINDS: Final[Mapping[str, type]] = {
    f"{kind.__name__[0].lower()}{kind.__name__[1:]}": kind for kind in get_args(Request)
}
"""Requests by the names that commands have in the file: that of the class, a few excepted."""
_OTHER_NAMES: Final = {"drive": "driveFor"}


class Dictionary:
    """Spells commands.

    Attributes:
        spelling: what the file says.
    """

    def __init__(self, spelling: Spelling, origin: str) -> None:
        """Check it whole.

        Args:
            spelling: what the file says.
            origin: the file's name, for errors.

        Raises:
            SettingsError: a command is not known, has other inputs, or two are spelled alike.
        """
        self.spelling = spelling
        self._by_kind: dict[type, Entry] = {}
        self._by_code: dict[int, tuple[Entry, type]] = {}
        for name, entry in spelling.commands.items():
            kind = _KINDS.get(_OTHER_NAMES.get(name, name))
            if kind is None:
                raise SettingsError(f"{origin}: there is no command {name}")
            wanted = tuple(names_of(kind))
            if entry.inputs != wanted:
                raise SettingsError(f"{origin}: inputs of {name} are {', '.join(wanted)}")
            if entry.code in self._by_code:
                raise SettingsError(f"{origin}: code {entry.code:#x} is there twice")
            self._by_kind[kind] = entry
            self._by_code[entry.code] = (entry, kind)

    def command(self, request: Request, identity: Identity, dest: str) -> Message:
        """Return the message that asks a destination for something.

        Raises:
            MopsError: the request cannot be spelled.
        """
        entry = self._by_kind.get(type(request))
        if entry is None:
            raise MopsError(f"there is no MOPS command for {type(request).__name__}")
        return Message(
            entry.code,
            identity.source,
            dest,
            entry.command,
            tuple(values_of(request)),
            moe_inputs_id=identity.command_id,
        )

    def request(self, message: Message) -> Request:
        """Return what a message asks for.

        Raises:
            MopsError: it is no command, or its inputs do not fit.
        """
        self.entry(message)
        _, kind = self._by_code[message.code]
        request: Request = made_of(kind, message.inputs)
        return request

    def entry(self, message: Message) -> Entry:
        """Return how the command is spelled that a message asks for or replies to.

        Raises:
            MopsError: it is none.
        """
        entry = self.entry_of(message.code)
        if entry.command != message.command:
            raise MopsError(f"code {message.code:03X} is {entry.command}, not {message.command}")
        return entry

    def entry_of(self, code: int) -> Entry:
        """Return how the command of a code is spelled.

        Raises:
            MopsError: there is none.
        """
        if code not in self._by_code:
            raise MopsError(f"code {code:03X} is no command")
        entry, _ = self._by_code[code]
        return entry


def load_dictionary(path: Path | None = None) -> Dictionary:
    """Return the dictionary of `config/mops/dictionary.yaml`, or of another file.

    Raises:
        SettingsError: there is none, or it does not fit.
    """
    path = path or config_folder() / "mops" / "dictionary.yaml"
    return Dictionary(read_yaml(path, Spelling), str(path))
