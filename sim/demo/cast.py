"""Who takes part in a demonstration: rovers with their scripts, and perhaps the relay."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sim.demo.script import Script
from sim.processes.deployment import Deployment, deployed
from sim.processes.guarding import Guarded
from sim.processes.place import Place

if TYPE_CHECKING:
    from sim.processes.relay import Orbiter


@dataclass(frozen=True, slots=True)
class Role:
    """A rover, what is to be played with it, and where what is left of it goes."""

    rover: Deployment
    script: Script
    folder: Path


@dataclass(frozen=True, slots=True)
class Cast:
    """All rovers of a demonstration.

    Attributes:
        orbiter: the relay; None where there is none.
    """

    roles: tuple[Role, ...]
    orbiter: "Orbiter | None" = None

    @property
    def rovers(self) -> tuple[Deployment, ...]:
        """The rovers."""
        return tuple(role.rover for role in self.roles)

    @property
    def processes(self) -> Guarded:
        """All processes, to be watched."""
        aboard = (child for rover in self.rovers for child in rover.children)
        return self.orbiter or Guarded(*aboard)


@contextmanager
def rovers_of(
    scripts: tuple[Script, ...], place: Place, folder: Path, seed: int
) -> Iterator[tuple[Role, ...]]:
    """Yield a rover that starts for each script; where they are several, each in its own folder."""
    with ExitStack() as running:
        roles: list[Role] = []
        for number, script in enumerate(scripts):
            own = folder / script.asset if len(scripts) > 1 else folder
            own.mkdir(exist_ok=True)
            there = place.beside(number)
            rover = deployed(there, own, script.asset, script.world, seed)
            roles.append(Role(running.enter_context(rover), script, own))
        yield tuple(roles)
