"""`python -m tests.stress.kills_client`: mission control that may be killed at any moment.

It commands, listens and fetches files as docs/own-client.md tells clients to: what it sends, it has
written down before; what was not acknowledged, it sends again; what it missed, it asks for.
"""

import asyncio
from argparse import ArgumentParser
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from random import Random
from time import time
from typing import Final

from adapters.mal import MalError, StandardError, Subscription, UpdateHeader
from adapters.mrs.ground import MrsClient, TransferError, parse_address
from adapters.mrs.ground.file_retrieval import RETRYABLE_ERRORS
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.ground.session import RoverSession
from adapters.mrs.spec import (
    LINK,
    AreaError,
    Notification,
    header_of,
    invocation,
    report_of,
    supplements_of,
)
from adapters.mrs.transport import CLEAR
from executive.commands.catalogue import Command, Stop
from executive.values.reports import Identity
from tests.stress.command_generator import SOURCE, random_command
from tests.stress.kills_journal import Answer, Answered, Fetched, Fetching, Route, Sent, View

ASSET: Final = "jackal"
SAMPLES: Final = ("samples/0.bin", "samples/1.bin")
JOURNAL: Final = "journal.jsonl"
COMMANDS: Final = "commands"
SETTLED: Final = "settled"
CHUNK_OCTETS: Final = 1024
"""Small, so that transfers last and kills meet them."""
TIMEOUT_S: Final = 5.0
PATIENCE_S: Final = 3600.0
POLL_S: Final = 1.0
"""At most between two looks at what is missing."""
PAUSE_S: Final = 1.0
"""At most between two bursts of commands."""
MAX_CONCURRENT: Final = 5
REPEATED: Final = 0.2
"""Of the bursts: with a command that was sent before, though it may well have been answered."""
QUIET_S: Final = 3.0
"""Without news, after which there is none."""
UNANSWERED: Final = {*RETRYABLE_ERRORS, StandardError.INTERNAL.value}
"""Errors that do not say whether the rover took the command."""
Restore = Callable[[RoverConsumer], Awaitable[None]]


class Listener:
    """Completes the view, over losses of both links.

    Args:
        finishing: whether the rover itself is to be asked too while nothing seems to be missing:
            what was said last may be missing, and nobody knows.
    """

    def __init__(self, view: View, finishing: bool) -> None:
        self._view, self._finishing = view, finishing
        self._gap = asyncio.Event()

    async def subscribe(self, broker: RoverConsumer) -> None:
        """Subscribe over a new connection with the broker; raises MalError."""
        subscription = Subscription(subscriptionId="view")
        await broker.subscribe(
            "NotificationClient", "monitorAssetNotification", subscription, self._on_update
        )
        self._gap.set()

    async def complete(self, broker: RoverSession, rover: RoverSession) -> None:
        """Ask for what is missing, for ever."""
        while True:
            with suppress(TimeoutError):
                await asyncio.wait_for(self._gap.wait(), POLL_S)
            self._gap.clear()
            await self._request(broker, Route.BROKER_MEMORY)
            if self._finishing or self._view.complete_to < self._view.newest:
                await self._request(rover, Route.LEDGER)

    async def _request(self, session: RoverSession, path: Route) -> None:
        consumer = await session.consumer()
        since = self._view.complete_to + 1
        try:
            while page := await self._page(consumer, path, since):
                for notification in page:
                    self._view.receive(report_of(notification), path)
                since = page[-1].sequence + 1
        except (MalError, ConnectionError):
            return  # the link was lost, or the broker has not heard of the rover yet

    async def _page(
        self, consumer: RoverConsumer, path: Route, since: int
    ) -> tuple[Notification, ...]:
        page: tuple[Notification, ...]
        if path is Route.LEDGER:
            (page,) = await consumer.request("Notification", "getNotifications", since, None, 0)
        else:
            (page,) = await consumer.request(
                "NotificationClient", "getNotifications", ASSET, since, 0
            )
        return page

    def _on_update(self, header: UpdateHeader, notification: Notification) -> None:
        asset = header.keyValues[0].value if header.keyValues else None
        if asset is None or asset.value != ASSET:
            return
        self._view.receive(report_of(notification), Route.BROKER)
        if self._view.complete_to < self._view.newest:
            self._gap.set()


class Client:
    """One life of the client.

    Args:
        folder: where the journal and the files that are fetched go.
        finishing: whether nothing new is to be begun, but a last stop.
    """

    def __init__(self, folder: Path, seed: int, finishing: bool) -> None:
        self._view = View(folder / JOURNAL)
        self._folder, self._seed, self._finishing = folder, seed, finishing
        self._random = Random(seed + self._view.entries)
        self._listener = Listener(self._view, finishing)

    async def run(self, rover_uri: str, broker_uri: str) -> None:
        rover = _session(rover_uri, _restore_nothing)
        broker = _session(broker_uri, self._listener.subscribe)
        await rover.open(patiently=True)
        listening = asyncio.create_task(self._listen(broker, rover))
        fetching = asyncio.create_task(self._fetch(rover_uri))
        await self._send(rover, self._view.unanswered)
        if self._finishing:
            await self._finish(rover, fetching)
        print(COMMANDS, flush=True)
        while not self._finishing:
            await self._send(rover, self._burst())
            await asyncio.sleep(self._random.uniform(0.0, PAUSE_S))
        await listening

    def _burst(self) -> list[Command]:
        """Return a few commands to be sent at once, now and then one that was sent before."""
        count, first = self._random.randint(1, MAX_CONCURRENT), self._view.next_number
        burst = [random_command(self._seed, first + n, LINK, time()) for n in range(count)]
        if self._random.random() < REPEATED and self._view.commands:
            burst.append(self._random.choice(self._view.commands))
        return burst

    async def _send(self, rover: RoverSession, commands: Sequence[Command]) -> None:
        """Send commands until each is acknowledged; they are written down before."""
        for command in commands:
            self._view.note(Sent(command))
        await asyncio.gather(*(self._deliver(rover, command) for command in commands))

    async def _deliver(self, rover: RoverSession, command: Command) -> None:
        call = invocation(command.request)
        while True:
            consumer = await rover.consumer()
            answer = Answer.TAKEN
            try:
                await consumer.submit(
                    call.service,
                    call.operation,
                    header_of(command),
                    *call.parts,
                    supplements=supplements_of(command),
                )
            except MalError as error:
                if error.number in UNANSWERED:
                    await rover.drop(consumer)
                    self._view.note(Sent(command))
                    continue
                again = error.number == AreaError.DUPLICATE.value
                answer = Answer.DUPLICATE if again else Answer.REFUSED
            self._view.note(Answered(command.identity, answer))
            return

    async def _listen(self, broker: RoverSession, rover: RoverSession) -> None:
        await broker.open(patiently=True)
        await self._listener.complete(broker, rover)

    async def _fetch(self, uri: str) -> None:
        """Fetch files, one after the other; in the end, the one that was begun."""
        client = await self._connected(uri)
        while (begun := self._view.interrupted) is not None or not self._finishing:
            path = self._random.choice(SAMPLES) if begun is None else begun.path
            name = self._view.next_name if begun is None else begun.name
            had = sum(part.stat().st_size for part in self._folder.glob(f"{name}.*.part"))
            self._view.note(Fetching(path, name, had))
            with suppress(ConnectionError, MalError, TransferError):
                to = self._folder / name
                await client.retrieve_file(path, to, chunk_octets=CHUNK_OCTETS)
                self._view.note(Fetched(path, name, sha256(to.read_bytes()).hexdigest()))
                to.unlink()
            await asyncio.sleep(self._random.uniform(0.0, 1.0))

    async def _connected(self, uri: str) -> MrsClient:
        while True:
            try:
                return await MrsClient.connect(uri, SOURCE, TIMEOUT_S, PATIENCE_S)
            except ConnectionError:
                await asyncio.sleep(PAUSE_S)

    async def _finish(self, rover: RoverSession, fetching: asyncio.Task[None]) -> None:
        last = Identity(SOURCE, self._view.next_number)
        await self._send(rover, [Command(last, Stop(), LINK, time())])
        await fetching
        known = -1
        while self._view.living or not known == self._view.newest == self._view.complete_to:
            known = self._view.newest
            await asyncio.sleep(QUIET_S)
        print(SETTLED, flush=True)


def _session(uri: str, restore: Restore) -> RoverSession:
    address = parse_address(uri)
    return RoverSession(address, SOURCE, CLEAR, restore, lambda _: None, TIMEOUT_S, PATIENCE_S)


async def _restore_nothing(_: RoverConsumer) -> None:
    pass


def main() -> None:
    line = ArgumentParser("kills-client")
    line.add_argument("--rover", required=True)
    line.add_argument("--broker", required=True)
    line.add_argument("--folder", type=Path, required=True)
    line.add_argument("--seed", type=int, required=True)
    line.add_argument("--finish", action="store_true")
    options = line.parse_args()
    client = Client(options.folder, options.seed, options.finish)
    asyncio.run(client.run(options.rover, options.broker))


if __name__ == "__main__":
    main()
