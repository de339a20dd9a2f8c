"""Ways to break a provider of the MRS from inside, each in a process that a test started."""

import asyncio
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from typing import Any

from adapters.mal import Connection, Header, InteractionStage, MalError, Provider
from adapters.mal.attribute_codec import READERS
from adapters.mal.provider import ReplyPath
from adapters.mrs.aboard import CoreGateway
from executive.commands.catalogue import Command
from executive.core.runner import Executive
from executive.values.geometry import Velocity
from executive.values.reports import Identity
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import LockStep

EVERY = 100
GET_STATUS = (10, 3)
RETAINED: list[Any] = []


def _taking(act: Callable[[Callable[[], None], Provider, Connection, Header], object]) -> None:
    """Have every message taken by `act(take, provider, connection, header)`."""
    take = Provider._receive

    def receive(self: Provider, connection: Connection, header: Header, body: bytes) -> None:
        act(partial(take, self, connection, header, body), self, connection, header)

    Provider._receive = receive  # type: ignore[method-assign]


def _every(act: Callable[[Connection], None], instead: bool = False) -> None:
    """Do something at one request of a hundred, before it is taken or instead."""
    counted = count(1)

    def at(take: Callable[[], None], _: Provider, connection: Connection, header: Header) -> None:
        now = (
            header.stage in (InteractionStage.SUBMIT, InteractionStage.REQUEST)
            and next(counted) % EVERY == 0
        )
        if now:
            act(connection)
        if not (now and instead):
            take()

    _taking(at)


def dies() -> None:
    _every(lambda _: os._exit(3))


def is_silent() -> None:
    _every(lambda _: None, instead=True)


def hangs_up() -> None:
    _every(lambda connection: connection.refuse("for fun"))


def answers_twice() -> None:
    _taking(lambda take, *_: (take(), take()))


def is_lenient() -> None:
    def finish(_: Any) -> None:
        pass

    for reader in READERS.values():
        reader.finish = finish  # type: ignore[assignment, method-assign]


def raises() -> None:
    def query(*_: object) -> None:
        raise RuntimeError("broken")

    CoreGateway.query = query  # type: ignore[assignment, method-assign]


def grows() -> None:
    def retain(take: Callable[[], None], *_: object) -> None:
        RETAINED.append(os.urandom(20_000))
        take()

    _taking(retain)


def leaks_files() -> None:
    _every(lambda _: RETAINED.append(os.dup(0)))


def leaks_tasks() -> None:
    _every(lambda _: RETAINED.append(asyncio.ensure_future(asyncio.Event().wait())))


def leaks_connections() -> None:
    def retain(take: Callable[[], None], *message: object) -> None:
        RETAINED.append(message)
        take()

    _taking(retain)


def serves_no_client() -> None:
    def refuse(take: Callable[[], None], self: Provider, *message: Any) -> None:
        connection, header = message
        if (header.service, header.operation) == GET_STATUS:
            ReplyPath(connection, header, self._codec, self._system).refuse(MalError(7))
        else:
            take()

    _taking(refuse)


def rolls_away() -> None:
    run = LockStep.run

    def roll(self: LockStep, duration_s: float) -> None:
        run(self, duration_s)
        assert isinstance(self.rover, SimulatedJackal)
        self.rover.drive(Velocity(0.3, 0.0))

    LockStep.run = roll  # type: ignore[method-assign]


def moves_by_itself() -> None:
    Executive.velocity = property(lambda _: Velocity(0.1, 0.0))  # type: ignore[assignment, method-assign]


def accepts_commands_without_source() -> None:
    submit = CoreGateway.submit

    def haunted(self: CoreGateway, command: Command) -> Any:
        ghost = Identity("ghost", command.identity.command_id)
        return submit(self, replace(command, identity=ghost))

    CoreGateway.submit = haunted  # type: ignore[method-assign]
