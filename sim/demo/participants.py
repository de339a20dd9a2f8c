"""Who takes part in a demonstration: rovers with their scripts, and perhaps the relay."""

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sim.demo.script import Link, Script
from sim.processes import Deployment, ProcessGroup, RoverAddress, deployed

if TYPE_CHECKING:
    from sim.processes.relay import Orbiter


@dataclass(frozen=True, slots=True)
class Participant:
    """A rover, what is to be played with it, and where what is left of it goes."""

    rover: Deployment
    script: Script
    folder: Path


@dataclass(frozen=True, slots=True)
class Participants:
    """All rovers of a demonstration."""

    members: tuple[Participant, ...]
    orbiter: "Orbiter | None" = None

    @property
    def rovers(self) -> tuple[Deployment, ...]:
        """The rovers."""
        return tuple(participant.rover for participant in self.members)

    @property
    def processes(self) -> ProcessGroup:
        """All processes, to be watched."""
        aboard = (child for rover in self.rovers for child in rover.children)
        return self.orbiter or ProcessGroup(*aboard)

    async def uris(self) -> list[str]:
        """Wait until all rovers are served, and return where, by all links."""
        links = (Link.DIRECT, *(() if self.orbiter is None else (Link.RELAY,)))
        return [await self.uri(member, link) for member in self.members for link in links]

    async def uri(self, member: Participant, link: Link) -> str:
        """Wait until a rover is served by a link, and return where."""
        if link is Link.RELAY and self.orbiter is not None:
            return await self.orbiter.uri(member.script.asset)
        return await member.rover.uri()


@contextmanager
def start_rovers(
    scripts: tuple[Script, ...], place: RoverAddress, folder: Path, seed: int, speed: float = 1.0
) -> Iterator[tuple[Participant, ...]]:
    """Yield a rover that starts for each script; where they are several, each in its own folder."""
    with ExitStack() as running:
        members = []
        for number, script in enumerate(scripts):
            own = folder / script.asset if len(scripts) > 1 else folder
            there = place.beside(number)
            rover = deployed(there, own, script.asset, script.world, seed, speed=speed)
            members.append(Participant(running.enter_context(rover), script, own))
        yield tuple(members)


DEFAULT: Final = "jackal"


def proposals(participants: Participants) -> str:
    """Return commands to try, with a heading."""
    lines = ["", "The rovers stay." if len(participants.members) > 1 else "The rover stays."]
    lines[-1] += " From a second terminal, in this folder:"
    for participant in participants.members:
        lines += ["", *(f"  ./rover {words}" for words in _proposed(participant, participants))]
    return "\n".join([*lines, ""])


def _proposed(participant: Participant, participants: Participants) -> Iterator[str]:
    asset = participant.script.asset
    first = participant is participants.members[0]
    there = "" if first else f" --to 127.0.0.1:{participant.rover.place.port}"
    yield f"command{there} moveTo 3 2 --heading 90deg"
    yield f"command{there} stop"
    yield f"command{there} resume"
    yield f"status{there}"
    yield "watch" if asset == DEFAULT else f"watch --asset {asset}"
    if participants.orbiter is not None:
        uri = asyncio.run(participants.uri(participant, Link.RELAY))
        relay = uri.removeprefix("maltcp://").removesuffix("/MRS")
        yield f"command --to {relay} moveForward -0.5"
        yield f"status --to {relay}"
