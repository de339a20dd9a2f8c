"""Reads a `Change` from texts, and applies it to the settings and the timeline of a recording."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from adapters.mrs.cli.command_text import read_command_text
from executive.commands import DIRECT_LINK, FollowPath, MoveTo, PreemptionPolicy, Request
from executive.settings import (
    Controller,
    FormatError,
    Settings,
    SettingsError,
    config_folder,
    faults_of,
    named_file,
    parse_yaml,
    settings_reader,
)
from executive.values.reports import Identity
from sim.fork.model import AddedCommand, Change
from sim.rover import World, load_world
from sim.rover.faults import fault_declaration
from sim.scenario.changes import Override, replaced
from sim.scenario.model import Clear, Entry, Fix, Inject, Send

NEVER_S: Final = 1e9
"""Time of entries that are left out; a timeline has finite times."""
LABEL: Final = "added"
"""Label of added commands, before their number."""
SCANS: Final = "scans"
"""Name of the world of measured obstacles."""


def read_change(
    settings: Iterable[str],
    commands: Iterable[str],
    dropped: Iterable[str],
    without: Iterable[str],
    controller: str | None,
    world: str | None,
) -> Change:
    """Return the change of these options of `rover whatif`.

    Raises:
        SettingsError: a text cannot be read.
    """
    try:
        overrides = tuple(map(Override.parse, settings))
        typed = [read_command_text(each, Identity("MOE", 1), DIRECT_LINK) for each in commands]
    except ValueError as error:
        text = str(error).replace("world.friction=0.4", "drive.travel_speed=0.6")
        raise SettingsError(text) from error
    return Change(
        settings=overrides,
        controller=None if controller is None else Controller(controller),
        world=None if world in (None, SCANS) else _world(world),
        scans=world == SCANS,
        added=tuple(AddedCommand(each.request, preemption=each.preemption) for each in typed),
        dropped=tuple(map(_identity, dropped)),
        without=tuple(without),
    )


def _identity(text: str) -> Identity:
    identity = Identity.parse(text)
    if identity is None:
        raise SettingsError(f"--drop {text!r} is no command id such as MOE:2")
    return identity


def _world(name: str) -> World:
    folder = config_folder() / "worlds"
    return load_world(Path(name) if name.endswith(".yaml") else named_file("world", name, folder))


def changed_settings(settings: Settings, change: Change) -> Settings:
    """Return the settings of a fork.

    Raises:
        SettingsError: a key is unknown, or a value does not fit.
    """
    made = change.asset or settings
    if made.asset != settings.asset:
        raise SettingsError(f"the recording is of {settings.asset}, not of {made.asset}")
    for each in change.settings:
        with faults_of(f"--set {each}"):
            made = _with(made, each)
    if change.controller is not None:
        try:
            made = replace(made, controller=change.controller)
        except ValueError as error:
            raise SettingsError(f"--controller {change.controller.value}: {error}") from error
    return made


def _with(settings: Settings, change: Override) -> Settings:
    """Return settings with a key, spelled without or with the unit of its field, replaced."""
    value, errors = parse_yaml(change.value, "the value"), []
    for reader in (settings_reader(), settings_reader(units=True)):
        try:
            raw = replaced(reader.plain(settings), change.key.split("."), value)
            made: Settings = reader.read(raw, Settings)
        except ValueError as error:
            errors.append(error)
        else:
            return made
    raise FormatError("", str(errors[0]))


def identities(timeline: Sequence[Entry]) -> dict[int, Identity]:
    """Return the identity of each command of a timeline, by its index in it."""
    sends = [index for index, each in enumerate(timeline) if isinstance(each, Send | Fix)]
    return {
        index: Identity(each.source, position if each.id is None else each.id)
        for position, index in enumerate(sends, 1)
        if isinstance(each := timeline[index], Send)
    }


def changed_timeline(
    timeline: Sequence[Entry], change: Change, at_s: float | None
) -> tuple[Entry, ...]:
    """Return the timeline of a fork; entries stay at their indexes, as commands are numbered so.

    Args:
        timeline: timeline of the scenario.
        change: change of the fork.
        at_s: time of added commands that have none.

    Raises:
        SettingsError: there is no such command or fault, or an added command has no time.
    """
    made, known = list(timeline), identities(timeline)
    requests = {each.identity: each.request for each in change.replaced}
    if missing := next((e for e in (*change.dropped, *requests) if e not in known.values()), None):
        raise SettingsError(f"no command {missing} was sent; there are: {_names(known.values())}")
    for index, identity in known.items():
        entry = made[index]
        assert isinstance(entry, Send)
        request = requests.get(identity, entry.command)
        made[index] = replace(entry, command=_controlled(request, change.controller))
        if identity in change.dropped:
            made[index] = _never(entry)
    faults = [each for each in timeline if isinstance(each, Inject)]
    names = {fault_declaration(type(each.inject)).name for each in faults}
    if unknown := next((each for each in change.without if each not in names), None):
        raise SettingsError(f"no fault {unknown!r} was injected; there are: {_names(names)}")
    for index, entry in enumerate(made):
        if isinstance(entry, Inject | Clear) and _fault_name(entry) in change.without:
            made[index] = _never(entry)
    operator = [*known.values()][-1].source if known else "MOE"
    first = 1 + max((each.command_id for each in known.values()), default=0)
    return (*made, *_additions(change, at_s, Identity(operator, first)))


def _additions(change: Change, at_s: float | None, first: Identity) -> Iterator[Entry]:
    for number, added in enumerate(change.added):
        time_s = at_s if added.at_s is None else added.at_s
        if time_s is None:
            raise SettingsError("an added command needs a time: give --at SECONDS")
        yield Send(
            at_s=time_s,
            command=_controlled(added.request, change.controller),
            label=f"{LABEL} {number + 1}",
            id=first.command_id + number,
            source=first.source,
            replace=added.preemption is PreemptionPolicy.REPLACE,
        )
    for each in change.faults:
        yield Inject(at_s=each.begin_s, inject=each.fault)
        if each.end_s is not None:
            yield Clear(at_s=each.end_s, clear=type(each.fault))


def _controlled(request: Request, controller: Controller | None) -> Request:
    """Return a request with a controller, if it names another one."""
    if isinstance(request, MoveTo | FollowPath) and request.controller and controller:
        return replace(request, controller=controller)
    return request


def _fault_name(entry: Inject | Clear) -> str:
    kind = type(entry.inject) if isinstance(entry, Inject) else entry.clear
    return fault_declaration(kind).name


def _never(entry: Entry) -> Entry:
    return replace(entry, at_s=NEVER_S, after=None, near=None)


def _names(values: Iterable[object]) -> str:
    return ", ".join(dict.fromkeys(map(str, values))) or "none"
