"""Several rovers behind one orbiter: what a judge of one sees, and that they are kept apart."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Final, cast

from tests.simulated.ground import Journal
from tests.simulated.judge import Finding, Stores
from tests.simulated.process import Process
from tests.simulated.processes import MRS_PORT, Address
from tests.simulated.world import World, WorldError

SECOND: Final = "2"
"""The suffix of the processes of the second rover."""


def second(address: Address) -> Address:
    """Return the second rover behind the orbiter of the first."""
    return replace(
        address,
        asset=f"{address.asset}{SECOND}",
        node=address.node + 1,
        relay="10.0.2.2",
        executive="10.0.2.3",
        port=MRS_PORT + 1,
        suffix=SECOND,
    )


class _Seen:
    """The part of a world that belongs to one rover, by the names of the first one's processes."""

    def __init__(self, world: World, suffix: str) -> None:
        self._world, self._suffix = world, suffix

    @property
    def now_s(self) -> float:
        return self._world.now_s

    @property
    def errors(self) -> list[WorldError]:
        return self._world.errors

    @property
    def processes(self) -> Mapping[str, Process]:
        own = {
            name: self._world.processes[f"{name}{self._suffix}"] for name in ("relay", "executive")
        }
        return {"orbiter": self._world.processes["orbiter"], **own}


def seen(world: World, address: Address) -> World:
    """Return what a judge of one rover sees of a world: not a whole one."""
    return cast("World", _Seen(world, address.suffix)) if address.suffix else world


def check_apart(
    world: World, address: Address, journals: Mapping[str, Journal]
) -> Iterator[Finding]:
    """Check that only commands for a rover came to it.

    Args:
        world: with the stores.
        address: the rover.
        journals: of its own ground clients.
    """
    stores = Stores(seen(world, address), address.asset)
    sent = {identity for journal in journals.values() for identity in journal.sent}
    for identity in sorted(stores.landed | stores.aboard.commands.keys(), key=str):
        if identity not in sent:
            what = "a command of another rover came to a rover"
            yield Finding(world.now_s, what, f"{identity} to {address.asset}")
