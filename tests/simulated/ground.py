"""A ground client as a process of the simulated world, and what it came to know."""

import asyncio
from dataclasses import dataclass, field
from typing import Final

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import Notification
from executive.commands import Command, Request
from executive.reports import Identity
from tests.simulated.process import Process
from tests.simulated.system import SimSystem

SOURCE: Final = "MOE"
PATIENCE_S: Final = 1e9
AGAIN_S: Final = 1.0


@dataclass
class Journal:
    """What one ground client was asked and came to know over one link.

    Attributes:
        sent: commands, with the times at which they were sent first.
        acknowledged: those that the other end took, with the times.
        refused: those that it answered with an error.
        ends: with which stages `MrsClient.run` returned.
        received: notifications.
    """

    sent: dict[Identity, float] = field(default_factory=dict)
    acknowledged: dict[Identity, float] = field(default_factory=dict)
    refused: dict[Identity, str] = field(default_factory=dict)
    ends: dict[Identity, list[str]] = field(default_factory=dict)
    received: list[Notification] = field(default_factory=list)


class Ground:
    """Commands one rover over one link.

    Args:
        uri: the other end of the link.
        journal: takes what it comes to know.
    """

    def __init__(self, uri: str, journal: Journal) -> None:
        self._uri, self.journal = uri, journal
        self._process: Process | None = None
        self._client: asyncio.Future[MrsClient] | None = None

    def start(self, process: Process) -> None:
        """Connect, and stay so; the `start` of a process."""
        self._process = process
        process.run(self._serve(process))

    def send(self, request: Request, number: int) -> None:
        """Send a command and wait for its end; an event of the world."""
        process = self._process
        if process is not None and process.alive:
            loop = process.loop
            loop.call_soon(lambda: loop.create_task(self._run(request, number)))

    async def _serve(self, process: Process) -> None:
        self._client = asyncio.get_running_loop().create_future()
        client = await self._connected(process)
        stream = client.notifications()
        self._client.set_result(client)
        async for notification in stream:
            self.journal.received.append(notification)

    async def _connected(self, process: Process) -> "_Client":
        while True:
            try:
                client = await _Client.connect(
                    self._uri, SOURCE, patience_s=PATIENCE_S, system=SimSystem(process)
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
        command = client.command(request, command_id=number)
        journal.sent.setdefault(command.identity, asyncio.get_running_loop().time())
        outcome = await client.run(command)
        if outcome.refusal is not None:
            journal.refused[command.identity] = str(outcome.refusal)
        else:
            end = "given up" if outcome.stage is None else outcome.stage.name
            journal.ends.setdefault(command.identity, []).append(end)


class _Client(MrsClient):
    """Notes what the other end acknowledges."""

    journal: Journal

    async def submit(self, command: Command) -> None:
        """Send a command and return when it is taken."""
        await super().submit(command)
        now_s = asyncio.get_running_loop().time()
        self.journal.acknowledged.setdefault(command.identity, now_s)
