"""`Dictionary` converts requests to MOPS messages and back, by `config/mops/dictionary.yaml`."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from adapters.mops.codec import (
    MAX_CODE,
    MAX_UTC_S,
    Message,
    MopsError,
    from_values,
    names_of,
    require_name,
    require_within,
    values_of,
)
from executive.commands import Precondition, Request, all_declarations
from executive.settings import SettingsError, config_folder, read_yaml
from executive.values.parameters import Parameter
from executive.values.reports import Identity


@dataclass(frozen=True, slots=True)
class Entry:
    """Spelling of one command.

    Attributes:
        command: name of the message.
        inputs: names of its values: the fields of the request, in their order.
    """

    code: int
    command: str
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class TelemetryEntry:
    """Spelling of telemetry: the parameters in their order."""

    code: int
    command: str
    outputs: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class OtherEntry:
    """Spelling of a message type with values of its own."""

    code: int
    command: str


@dataclass(frozen=True, slots=True)
class Spelling:
    """Content of the dictionary file.

    Attributes:
        commands: code of each command.

    Raises:
        ValueError: a code or name is invalid or duplicate, telemetry does not list each parameter
            exactly once, or the stop is missing.
    """

    commands: Mapping[str, int]
    telemetry: TelemetryEntry
    event: OtherEntry
    link: OtherEntry
    keep_alive: OtherEntry = OtherEntry(0x303, "KEEP_ALIVE")
    authority: OtherEntry = OtherEntry(0x304, "AUTHORITY")
    housekeeping: OtherEntry = OtherEntry(0x305, "HOUSEKEEPING")
    questions: OtherEntry = OtherEntry(0x306, "QUESTIONS")

    def __post_init__(self) -> None:
        """Check what holds for every dictionary; `Dictionary` checks the set of commands."""
        seen: dict[str, str] = {}
        for key, code, command in self._by_key():
            if not 0 <= code <= MAX_CODE:
                raise ValueError(f"{key} has the code {code:#x}: 0x0 to {MAX_CODE:#x}")
            require_name(f"{key}.command", command)
            for what in (f"code {code:#x}", f"command {command}"):
                if (other := seen.setdefault(what, key)) != key:
                    raise ValueError(f"{key} has the {what}, as {other}: each needs its own")
        for parameter in Parameter:
            if (count := self.telemetry.outputs.count(parameter)) != 1:
                fault = f"has {parameter.value} twice" if count else f"lacks {parameter.value}"
                raise ValueError(f"telemetry.outputs {fault}: list each parameter once")
        if "stop" not in self.commands:
            raise ValueError("commands lacks stop: every rover needs a stop")

    def _by_key(self) -> Iterator[tuple[str, int, str]]:
        for name, code in self.commands.items():
            yield f"commands.{name}", code, message_name(name)
        for key, entry in (
            ("telemetry", self.telemetry),
            ("event", self.event),
            ("link", self.link),
            ("keep_alive", self.keep_alive),
            ("authority", self.authority),
            ("housekeeping", self.housekeeping),
            ("questions", self.questions),
        ):
            yield key, entry.code, entry.command


def message_name(command: str) -> str:
    """Return the name of a command's message: MOVE_TO for moveTo."""
    return re.sub(r"(?=[A-Z])", "_", command).upper()


_KINDS: Final[Mapping[str, type]] = {each.name: each.kind for each in all_declarations()}


@dataclass(frozen=True, slots=True)
class CommandConditions:
    """Authority, times and precondition of a command, and whether a stop overtook it.

    Attributes:
        authority: epoch claimed by the sender.
        created_utc_s: creation time at the sender, s UTC.
        lifetime_s: maximum time from the creation to the start, s.
        overtaken: whether a stop created later arrived earlier. The command is then not executed: a
            receiver without a record of it refuses it, all others repeat the last reply.
        only_at, only_after, only_mode: values of its precondition on a link.
    """

    authority: int | None = None
    created_utc_s: float | None = None
    lifetime_s: float | None = None
    overtaken: bool | None = None
    only_at: str | None = None
    only_after: int | None = None
    only_mode: str | None = None

    @property
    def precondition(self) -> Precondition | None:
        """The precondition; None without one. ValueError if it cannot be read."""
        return Precondition.from_wire(self.only_at, self.only_after, self.only_mode)


UNCONDITIONAL: Final = CommandConditions()
_MAX_EPOCH: Final = (1 << 63) - 1


class Dictionary:
    """Converts commands to messages and back.

    Attributes:
        spelling: content of the file.
        commands: spelling of each command, by its display name.
    """

    def __init__(self, spelling: Spelling, origin: str) -> None:
        """Check that each command is one of the core's.

        Args:
            spelling: content of the file.
            origin: name of the file, for errors.

        Raises:
            SettingsError: a command is unknown.
        """
        self.spelling = spelling
        self.commands: dict[str, Entry] = {}
        self._by_kind: dict[type, Entry] = {}
        self._by_code: dict[int, tuple[Entry, type]] = {}
        for name, code in spelling.commands.items():
            kind = _KINDS.get(name)
            if kind is None:
                known = ", ".join(sorted(_KINDS))
                raise SettingsError(f"{origin}: there is no command {name}; there are: {known}")
            entry = Entry(code, message_name(name), tuple(names_of(kind)))
            self.commands[name] = self._by_kind[kind] = entry
            self._by_code[code] = (entry, kind)

    def command(
        self,
        request: Request,
        identity: Identity,
        dest: str,
        conditions: CommandConditions = UNCONDITIONAL,
    ) -> Message:
        """Return the message that requests a command from a destination.

        Args:
            request: content of the command.
            identity: its source and number.
            dest: name of the receiver.
            conditions: sent in the field of the outputs, which a command does not use.

        Raises:
            MopsError: the request cannot be encoded.
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
            _trim(values_of(conditions)),
            moe_inputs_id=identity.command_id,
        )

    def request(self, message: Message) -> Request:
        """Return the request that a message carries.

        Raises:
            MopsError: it is not a command, or its inputs are invalid.
        """
        self.entry(message)
        _, kind = self._by_code[message.code]
        request: Request = from_values(kind, message.inputs)
        return request

    def is_stop(self, message: Message) -> bool:
        """Return whether a message requests a stop, regardless of other errors in it."""
        return message.code == self.spelling.commands["stop"] and not message.received

    def entry(self, message: Message) -> Entry:
        """Return the spelling of the command that a message requests or replies to.

        Raises:
            MopsError: it is neither.
        """
        entry = self.entry_of(message.code)
        if entry.command != message.command:
            raise MopsError(f"code {message.code:03X} is {entry.command}, not {message.command}")
        return entry

    def entry_of(self, code: int) -> Entry:
        """Return the spelling of the command with a code.

        Raises:
            MopsError: no command has this code.
        """
        if code not in self._by_code:
            raise MopsError(f"code {code:03X} is no command")
        entry, _ = self._by_code[code]
        return entry


def conditions_of(command: Message) -> CommandConditions:
    """Return the conditions of a command; absent ones are None.

    Raises:
        MopsError: its outputs are not conditions.
    """
    missing = ("",) * (len(CommandConditions.__slots__) - len(command.outputs))
    found: CommandConditions = from_values(CommandConditions, (*command.outputs, *missing))
    require_within("authority", found.authority, 0, _MAX_EPOCH)
    require_within("created_utc_s", found.created_utc_s, 0, MAX_UTC_S)
    try:
        _ = found.precondition
    except ValueError as fault:
        raise MopsError(f"precondition: {fault}") from fault
    return found


def mark_overtaken(command: Message) -> Message:
    """Return a copy of a command that is marked as overtaken by a stop."""
    authority, created_utc_s, lifetime_s, _, *only = *command.outputs, *[""] * 4
    return replace(command, outputs=_trim((authority, created_utc_s, lifetime_s, str(True), *only)))


def _trim(values: Iterable[str]) -> tuple[str, ...]:
    values = list(values)
    while values and not values[-1]:
        values.pop()
    return tuple(values)


def load_dictionary(path: Path | None = None) -> Dictionary:
    """Return the dictionary of `config/mops/dictionary.yaml`, or of another file.

    Raises:
        SettingsError: the file is missing or invalid.
    """
    path = path or config_folder() / "mops" / "dictionary.yaml"
    return Dictionary(read_yaml(path, Spelling), str(path))
