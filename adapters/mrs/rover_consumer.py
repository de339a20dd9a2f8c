"""One consumer for all services of a rover, each where the rover's directory says it is."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any, Protocol

from adapters.mal import Consumer, MalError, MalUri, NamedValue, OnUpdate, Progress, Subscription
from adapters.mrs.places import DIRECTORY, Place, Places, places_of


class Dial(Protocol):
    """Opens a connection; raises as `Consumer.connect` does."""

    async def __call__(self, uri: str, *, is_broker: bool) -> Consumer:
        """Connect to a provider, or a broker of its own."""
        ...


class RoverConsumer:
    """Has the calls of a `Consumer`, and takes each to where its service is.

    A connection to another place than the directory's is opened when it is first needed; when one
    is lost, all are to be made again. Besides what `Consumer` raises, the calls raise
    ConnectionError when nobody answers where the directory sends them.
    """

    def __init__(self, directory: Consumer, dial: Dial) -> None:
        """Take the connection to the directory; until `discover`, everything is there."""
        self._directory = directory
        self._dial = dial
        self._places = Places()
        self._opened: dict[Place, Consumer] = {}
        self._opening = asyncio.Lock()
        self._lost = asyncio.Event()
        self._watches = [asyncio.create_task(self._watch(directory))]

    async def discover(self, uri: MalUri) -> None:
        """Ask the directory, which was connected to by this URI; raises as `request` does."""
        (found,) = await self._directory.request(DIRECTORY, "getServices")
        self._places = places_of(found, uri)

    async def submit(
        self, service: str, operation: str, *parts: Any, supplements: tuple[NamedValue, ...] = ()
    ) -> None:
        """Do a SUBMIT, and return when it is acknowledged."""
        provider = await self._provider(service)
        await provider.submit(service, operation, *parts, supplements=supplements)

    async def request(self, service: str, operation: str, *parts: Any) -> tuple[Any, ...]:
        """Do a REQUEST, and return the parts of the response."""
        return await (await self._provider(service)).request(service, operation, *parts)

    @asynccontextmanager
    async def progress(self, service: str, operation: str, *parts: Any) -> AsyncIterator[Progress]:
        """Do a PROGRESS, which is entered when it is acknowledged."""
        provider = await self._provider(service)
        async with provider.progress(service, operation, *parts) as progress:
            yield progress

    async def subscribe(
        self, service: str, operation: str, subscription: Subscription, on_update: OnUpdate
    ) -> None:
        """Register a subscription with the service's broker."""
        place = self._places.brokers.get(service)
        broker = self._directory if place is None else await self._at(place, service)
        await broker.subscribe(service, operation, subscription, on_update)

    async def lost(self) -> None:
        """Return when any of the connections is gone, by whichever end."""
        await self._lost.wait()

    async def close(self) -> None:
        """Close all connections."""
        for watch in self._watches:
            watch.cancel()
        self._lost.set()
        for consumer in (self._directory, *self._opened.values()):
            await consumer.close()

    async def _provider(self, service: str) -> Consumer:
        place = self._places.providers.get(service)
        return self._directory if place is None else await self._at(place, service)

    async def _at(self, place: Place, service: str) -> Consumer:
        async with self._opening:
            if place not in self._opened:
                try:
                    opened = await self._dial(place.uri, is_broker=place.is_broker)
                except (MalError, ValueError) as error:
                    text = f"{service} is at {place.uri} by the directory: {error}"
                    raise ConnectionError(text) from error
                self._opened[place] = opened
                self._watches.append(asyncio.create_task(self._watch(opened)))
            return self._opened[place]

    async def _watch(self, consumer: Consumer) -> None:
        await consumer.lost()
        self._lost.set()
