"""Requests of the core as MOPS messages, and back, as `config/mops/dictionary.yaml` spells them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from adapters.mops.codec import (
    HIGHEST_CODE,
    LATEST_UTC_S,
    Message,
    MopsError,
    made_of,
    names_of,
    require_name,
    require_within,
    values_of,
)
from executive.commands import Request, declared
from executive.settings import SettingsError, config_folder, read_yaml
from executive.values.parameters import Parameter
from executive.values.reports import Identity


@dataclass(frozen=True, slots=True)
class Entry:
    """How one command is spelled.

    Attributes:
        code: the message's code.
        command: the message's name.
        inputs: names of its values: the fields of the request, in their order.
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
    """The file.

    Attributes:
        commands: their codes.

    Raises:
        ValueError: a code or a name cannot stand in a message or is there twice, telemetry has not
            each parameter once, or there is no stop.
    """

    commands: Mapping[str, int]
    telemetry: TelemetryEntry
    event: OtherEntry
    link: OtherEntry
    keep_alive: OtherEntry = OtherEntry(0x303, "KEEP_ALIVE")
    authority: OtherEntry = OtherEntry(0x304, "AUTHORITY")
    housekeeping: OtherEntry = OtherEntry(0x305, "HOUSEKEEPING")

    def __post_init__(self) -> None:
        """Check what is true of any dictionary; which commands there are is `Dictionary`'s."""
        seen: dict[str, str] = {}
        for key, code, command in self._by_key():
            if not 0 <= code <= HIGHEST_CODE:
                raise ValueError(f"{key} has the code {code:#x}: 0x0 to {HIGHEST_CODE:#x}")
            require_name(f"{key}.command", command)
            for what in (f"code {code:#x}", f"command {command}"):
                if (other := seen.setdefault(what, key)) != key:
                    raise ValueError(f"{key} has the {what}, as {other}: each needs its own")
        for parameter in Parameter:
            if (count := self.telemetry.outputs.count(parameter)) != 1:
                fault = f"has {parameter.value} twice" if count else f"lacks {parameter.value}"
                raise ValueError(f"telemetry.outputs {fault}: each parameter stands there once")
        if "stop" not in self.commands:
            raise ValueError("commands lacks stop: no rover goes without one")

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
        ):
            yield key, entry.code, entry.command


def message_name(command: str) -> str:
    """Return the name of the message of a command: MOVE_TO of moveTo."""
    return re.sub(r"(?=[A-Z])", "_", command).upper()


_KINDS: Final[Mapping[str, type]] = {each.name: each.kind for each in declared()}


@dataclass(frozen=True, slots=True)
class CommandConditions:
    """By which authority a command is given, how long it is to live, what overtook it.

    Attributes:
        authority: the epoch that its sender claims.
        created_utc_s: when its sender made it.
        lifetime_s: for how long from then it may start.
        overtaken: whether a stop that was made after it came before it. Then it is not executed:
            who has not recorded it refuses it, all others repeat the last reply.
    """

    authority: int | None = None
    created_utc_s: float | None = None
    lifetime_s: float | None = None
    overtaken: bool | None = None


UNCONDITIONAL: Final = CommandConditions()
_HIGHEST_EPOCH: Final = (1 << 63) - 1


class Dictionary:
    """Spells commands.

    Attributes:
        spelling: what the file says.
        commands: how each is spelled, by the name that it has for people.
    """

    def __init__(self, spelling: Spelling, origin: str) -> None:
        """Check that the commands are those of the core.

        Args:
            spelling: what the file says.
            origin: the file's name, for errors.

        Raises:
            SettingsError: a command is not known.
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
        """Return the message that asks a destination for something.

        Args:
            request: what is asked for.
            identity: who asks, and under which number.
            dest: who is asked.
            conditions: stand where a reply has its outputs, which a command has not.

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
            _trimmed(conditions),
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

    def is_stop(self, message: Message) -> bool:
        """Return whether a message asks for a stop, whatever else is wrong with it."""
        return message.code == self.spelling.commands["stop"] and not message.received

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


def conditions_of(command: Message) -> CommandConditions:
    """Return the conditions of a command; what it does not say is None.

    Raises:
        MopsError: it has other outputs.
    """
    missing = ("",) * (len(CommandConditions.__slots__) - len(command.outputs))
    found: CommandConditions = made_of(CommandConditions, (*command.outputs, *missing))
    require_within("authority", found.authority, 0, _HIGHEST_EPOCH)
    require_within("created_utc_s", found.created_utc_s, 0, LATEST_UTC_S)
    return found


def mark_overtaken(command: Message) -> Message:
    """Return a command that says in its conditions that a stop has overtaken it."""
    authority, created_utc_s, lifetime_s, *_ = *command.outputs, "", "", ""
    return replace(command, outputs=(authority, created_utc_s, lifetime_s, str(True)))


def _trimmed(conditions: CommandConditions) -> tuple[str, ...]:
    values = list(values_of(conditions))
    while values and not values[-1]:
        values.pop()
    return tuple(values)


def load_dictionary(path: Path | None = None) -> Dictionary:
    """Return the dictionary of `config/mops/dictionary.yaml`, or of another file.

    Raises:
        SettingsError: there is none, or it does not fit.
    """
    path = path or config_folder() / "mops" / "dictionary.yaml"
    return Dictionary(read_yaml(path, Spelling), str(path))
