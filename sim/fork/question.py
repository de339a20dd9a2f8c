"""Reads a `Change` from the texts of a command line."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final

from adapters.mrs.cli.command_text import read_command_text
from executive.commands import DIRECT_LINK
from executive.settings import Controller, SettingsError, config_folder, named_file
from executive.values.reports import Identity
from sim.fork.model import AddedCommand, Change
from sim.rover import World, load_world
from sim.scenario.changes import Override

SCANS: Final = "scans"


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
