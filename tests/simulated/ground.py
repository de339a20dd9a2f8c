"""A ground client as a process of the simulated world, and what it came to know.

When it is killed, its journal stays, as an operator's notes do. A new client asks for the end of
each command that was acknowledged to a former one, and sends again what was not.
"""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Final

from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.ground.session import SessionAuthority
from adapters.mrs.spec import AreaError, AuthorityStatus, ReceivedReport, Stage, lost_command
from executive.commands import Command, Request
from executive.values.reports import TERMINAL, Identity, Report
from tests.simulated.process import Process
from tests.simulated.system import SimSystem

SOURCE: Final = "MOE"
PATIENCE_S: Final = 1e9
AuthorityCall = Callable[[SessionAuthority], Awaitable[AuthorityStatus]]
AGAIN_S: Final = 1.0


@dataclass
class Journal:
    """What one ground client, and those before it, were asked and came to know over one link.

    Attributes:
        sent: commands, with the times at which they were sent first.
        requests: what they ask for.
        acknowledged: those that the other end took, with the times.
        refused: those that it answered with an error, other than that it knows them already.
        ends: their stages at the end, as `MrsClient.run` or `getNotifications` told.
        received: reports.
        claims: under which epochs of the authority commands were sent; None for none.
        epochs: those that it held by what it was told.
        denied: with which errors it was refused the authority.
    """

    sent: dict[Identity, float] = field(default_factory=dict)
    requests: dict[Identity, Request] = field(default_factory=dict)
    acknowledged: dict[Identity, float] = field(default_factory=dict)
    refused: dict[Identity, str] = field(default_factory=dict)
    ends: dict[Identity, list[str]] = field(default_factory=dict)
    received: list[Report] = field(default_factory=list)
    claims: dict[Identity, list[int | None]] = field(default_factory=dict)
    epochs: list[int] = field(default_factory=list)
    denied: list[str] = field(default_factory=list)

    @property
    def open(self) -> list[Identity]:
        """Return the commands of which no end is known, in the order of sending."""
        return [each for each in self.sent if each not in self.ends and each not in self.refused]

    def hold(self, epoch: int) -> None:
        """Note that it holds the authority."""
        if epoch not in self.epochs:
            self.epochs.append(epoch)

    def end(self, identity: Identity, stage: str) -> None:
        """Note an end."""
        self.ends.setdefault(identity, []).append(stage)


class Ground:
    """Commands one rover over one link.

    Args:
        uri: the other end of the link.
        journal: takes what it comes to know.
        source: the name under which it commands.

    Attributes:
        lent: the epoch under which the orbiter holds the authority for it, as far as it knows.
    """

    def __init__(self, uri: str, journal: Journal, source: str = SOURCE) -> None:
        self._uri, self.journal, self.source = uri, journal, source
        self.lent: int | None = None
        self._process: Process | None = None
        self._client: asyncio.Future[MrsClient] | None = None

    def start(self, process: Process) -> None:
        """Connect, and stay so; the `start` of a process."""
        self._process = process
        self._client = process.loop.create_future()
        process.run(self._serve(process, self._client))

    def send(self, request: Request, number: int) -> None:
        """Send a command and wait for its end; an event of the world."""
        process = self._process
        if process is not None and process.alive:
            loop = process.loop
            loop.call_soon(lambda: loop.create_task(self._run(request, number)))

    def request(self, request: AuthorityCall, relay: "Ground") -> None:
        """Do something about the authority; an event of the world.

        Args:
            request: what.
            relay: commands by the relay, under the epoch that the orbiter gets for it.
        """
        process = self._process
        if process is not None and process.alive:
            loop = process.loop
            loop.call_soon(lambda: loop.create_task(self._request(request, relay)))

    async def _serve(self, process: Process, connected: "asyncio.Future[MrsClient]") -> None:
        client = await self._connected(process)
        stream = client.notifications()
        former = self.journal.open
        connected.set_result(client)
        async with asyncio.TaskGroup() as requesting:
            for identity in former:
                requesting.create_task(self._resume(client, identity))
            async for received in stream:
                self.journal.received.append(received.report)

    async def _connected(self, process: Process) -> "_Client":
        while True:
            try:
                client = await _Client.connect(
                    self._uri, self.source, patience_s=PATIENCE_S, system=SimSystem(process)
                )
            except ConnectionError:
                await asyncio.sleep(AGAIN_S)
            else:
                assert isinstance(client, _Client)
                client.journal = self.journal
                return client

    async def _run(self, request: Request, number: int) -> None:
        assert self._client is not None
        client, journal = await asyncio.shield(self._client), self.journal
        if self.lent is not None:
            client.authority.epoch = self.lent
        command = client.command(request, command_id=number)
        journal.sent.setdefault(command.identity, asyncio.get_running_loop().time())
        journal.requests[command.identity] = request
        await self._command(client, command)

    async def _resume(self, client: MrsClient, identity: Identity) -> None:
        """Go on with a command of a client that was killed."""
        if identity in self.journal.acknowledged:
            await self._learn(client, identity)
        else:
            request = self.journal.requests[identity]
            await self._command(client, client.command(request, command_id=identity.command_id))

    async def _request(self, query: AuthorityCall, relay: "Ground") -> None:
        assert self._client is not None
        client = await asyncio.shield(self._client)
        try:
            status = await query(client.authority)
        except MalError as refusal:
            self.journal.denied.append(str(refusal))
        else:
            if status.holder == self.source:
                self.journal.hold(status.epoch)
            elif relay.source == self.source:
                relay.lent = status.epoch

    async def _command(self, client: MrsClient, command: Command) -> None:
        epoch = command.authority
        self.journal.claims.setdefault(command.identity, []).append(epoch)
        if epoch is not None and epoch != self.lent:
            self.journal.hold(epoch)
        outcome = await client.run(command)
        refusal = outcome.refusal
        if refusal is None:
            end = "given up" if outcome.stage is None else outcome.stage.name
            self.journal.end(command.identity, end)
        elif refusal.number == AreaError.DUPLICATE.value:
            await self._learn(client, command.identity)
        else:
            self.journal.refused[command.identity] = str(refusal)

    async def _learn(self, client: MrsClient, identity: Identity) -> None:
        """Ask for the end of a command, and wait for it."""
        stream = client.notifications()  # first, so that nothing falls between
        try:
            for reported in await self._notifications(client, identity):
                if (end := _end_of(reported.report, identity)) is not None:
                    return self.journal.end(identity, end)
            async for reported in stream:
                if (end := _end_of(reported.report, identity)) is not None:
                    return self.journal.end(identity, end)
        finally:
            stream.close()

    async def _notifications(
        self, client: MrsClient, identity: Identity
    ) -> tuple[ReceivedReport, ...]:
        """Return what is known on a command, as soon as the other end can read its record."""
        while True:
            try:
                return tuple(await client.get_all_notifications(command_id=identity.command_id))
            except MalError:
                await asyncio.sleep(AGAIN_S)


def _end_of(reported: Report, identity: Identity) -> str | None:
    """Return with which stage a command ended by a report; None if it tells no end of it."""
    if lost_command(reported) == identity:
        return "given up"
    ended = reported.stage in TERMINAL and reported.identity == identity
    return Stage(reported.stage).name if ended and reported.stage is not None else None


class _Client(MrsClient):
    """Notes what the other end acknowledges."""

    journal: Journal

    async def submit(self, command: Command) -> None:
        """Send a command and return when it is taken."""
        await super().submit(command)
        now_s = asyncio.get_running_loop().time()
        self.journal.acknowledged.setdefault(command.identity, now_s)
