"""The connection with the service layer above, which this asset does not depend on."""

import asyncio
import logging
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any, Final

from adapters.mal import Consumer, MalError, MalUri, StandardError
from adapters.mrs.core import Core
from adapters.mrs.dialling import Dialling
from adapters.mrs.directory_service import SERVICE
from adapters.mrs.errors import AreaError, in_words
from adapters.mrs.fleet_listener import FleetListener
from adapters.mrs.fleet_speaker import FleetSpeaker
from adapters.mrs.types import AssetInfo, ServiceDescriptor
from executive.reports import Kind, Severity

_LOG: Final = logging.getLogger(__name__)

FIRST_PAUSE_S: Final = 0.2
LONGEST_PAUSE_S: Final = 5.0
"""Between two attempts to connect; twice as long each time."""
HEARTBEAT_S: Final = 5.0
"""Between two questions that tell whether somebody is still there, and who else."""
FAREWELL_S: Final = 0.5
"""How long the end of this process may wait to have said the rest, and again to deregister."""


class FleetLink:
    """Registers, speaks and listens; after a loss again, for ever.

    That the service layer is lost, and that it is back, is reported as of the kind LINK.

    Args:
        uri: where the service layer is.
        registration: makes the descriptor to register, given this end's address of a connection.
        on_above: called with the Service Layer that this asset is registered at.
    """

    def __init__(
        self,
        uri: MalUri,
        core: Core,
        dialling: Dialling,
        registration: Callable[[str], ServiceDescriptor],
        on_above: Callable[[ServiceDescriptor], None],
        speaker: FleetSpeaker,
        listener: FleetListener,
    ) -> None:
        """Prepare; nothing is connected yet."""
        self._uri = uri
        self._core = core
        self._dialling = dialling
        self._registration = registration
        self._on_above = on_above
        self._speaker = speaker
        self._listener = listener
        self._connected: bool | None = None
        self._registered: tuple[Consumer, str] | None = None
        self._task: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin, and go on until `leave`."""
        self._task = asyncio.create_task(self._run())

    async def leave(self) -> None:
        """Say the rest and deregister, if that can be done soon; then hang up."""
        if self._registered is not None:
            consumer, name = self._registered
            with suppress(TimeoutError):
                async with asyncio.timeout(FAREWELL_S):
                    await self._speaker.silent.wait()
            with suppress(MalError, TimeoutError):
                async with asyncio.timeout(FAREWELL_S):
                    await consumer.submit(SERVICE, "deregisterService", name)
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        loop = asyncio.get_running_loop()
        pause_s = FIRST_PAUSE_S
        while True:
            began_s = loop.time()
            try:
                await self._belong()
            except (MalError, OSError) as fault:
                self._tell(False, f"the service layer at {self._uri} {_in_words(fault)}")
            except Exception:  # whatever is wrong with it, the rover's own services go on
                _LOG.exception("service layer at %s", self._uri)
                self._tell(False, f"the service layer at {self._uri} makes no sense")
            if loop.time() - began_s > LONGEST_PAUSE_S:
                pause_s = FIRST_PAUSE_S
            await asyncio.sleep(pause_s)
            pause_s = min(2 * pause_s, LONGEST_PAUSE_S)

    async def _belong(self) -> None:
        """Be a member over one connection, until it is lost, which raises."""
        await self._speaker.note_beginning()
        consumer = await self._dialling.connect(self._uri)
        try:
            await self._register(consumer)
            await _first_to_end(
                self._speaker.speak(consumer), self._listen(consumer), _lost(consumer)
            )
        finally:
            self._registered = None
            await consumer.close()

    async def _register(self, consumer: Consumer) -> None:
        own = self._registration(consumer.local_address[0])
        await consumer.submit(SERVICE, "registerService", own)
        self._registered = (consumer, own.name)
        above: ServiceDescriptor
        (above,) = await consumer.request(SERVICE, "getService", SERVICE)
        self._on_above(above)
        self._tell(True, f"registered as {own.name} at the service layer at {self._uri}")

    async def _listen(self, consumer: Consumer) -> None:
        host: AssetInfo
        (host,) = await consumer.request(SERVICE, "getAsset")
        await self._listener.listen(consumer, host.asset, str(self._uri))
        while True:
            with suppress(TimeoutError):
                async with asyncio.timeout(HEARTBEAT_S):
                    await self._listener.strangers.wait()
            await self._listener.learn(consumer)

    def _tell(self, connected: bool, text: str) -> None:
        """Report a change; nothing is reported twice in a row."""
        if connected is self._connected:
            _LOG.debug("%s", text)
            return
        self._connected = connected
        severity = Severity.INFORMATIONAL if connected else Severity.WARNING
        told = self._core.ask(lambda executive: executive.event(severity, text, kind=Kind.LINK))
        told.add_done_callback(lambda done: done.cancelled() or done.exception())


def _in_words(fault: MalError | OSError) -> str:
    if not isinstance(fault, MalError):
        return f"is away: {fault}"
    refused = any(fault.number == error.value for error in AreaError)
    return f"{'refuses this asset' if refused else 'is away'}: {in_words(fault)}"


async def _lost(consumer: Consumer) -> None:
    await consumer.lost()
    raise MalError(StandardError.DESTINATION_LOST)


async def _first_to_end(*works: Coroutine[Any, Any, None]) -> None:
    """Do things side by side until one ends or raises; the others are cancelled."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
