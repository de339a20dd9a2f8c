"""`Question`: a what-if question as texts, from the command line or another process."""

from dataclasses import dataclass
from pathlib import Path

from executive.settings import Controller, SettingsError, config_folder, figure, named_file
from executive.values.reports import Identity
from sim.fork.model import AddedCommand, Change
from sim.rover import World, load_world
from sim.scenario.changes import Override


@dataclass(frozen=True, slots=True)
class Question:
    """A question on a recording; its attributes are the options of `rover whatif`."""

    recording: str
    at_s: float | None = None
    set: tuple[str, ...] = ()
    command: tuple[str, ...] = ()
    drop: tuple[str, ...] = ()
    without: tuple[str, ...] = ()
    controller: str | None = None
    world: str | None = None
    seeds: int = figure(1, default=1)

    def change(self) -> Change:
        """Return the change that it is on.

        Raises:
            SettingsError: a text cannot be read.
            click.UsageError: a command has another form.
        """
        return Change(
            settings=tuple(map(_override, self.set)),
            controller=None if self.controller is None else Controller(self.controller),
            world=None if self.world is None else _world(self.world),
            added=tuple(map(_command, self.command)),
            dropped=tuple(map(_identity, self.drop)),
            without=self.without,
        )

    @property
    def text(self) -> str:
        """The change as text."""
        return ", ".join(
            [
                *(f"with {each}" for each in self.set),
                *([f"with {self.controller}"] if self.controller else []),
                *([f"in {self.world}"] if self.world else []),
                *(f"with {each!r}" for each in self.command),
                *(f"without {each}" for each in (*self.drop, *self.without)),
            ]
        )


def _override(text: str) -> Override:
    try:
        return Override.parse(text)
    except ValueError as error:
        raise SettingsError(
            f"--set {error}".replace("world.friction=0.4", "drive.travel_speed=0.6")
        ) from error


def _command(text: str) -> AddedCommand:
    from adapters.mrs.cli.command_group import read_command

    request, preemption = read_command(text)
    return AddedCommand(request, preemption=preemption)


def _identity(text: str) -> Identity:
    identity = Identity.parse(text)
    if identity is None:
        raise SettingsError(f"--drop {text!r} is no command id such as MOE:2")
    return identity


def _world(name: str) -> World:
    folder = config_folder() / "worlds"
    return load_world(Path(name) if name.endswith(".yaml") else named_file("world", name, folder))
