"""The direct link, aboard: serves the MRS over MAL on a thread of its own."""

import asyncio
import logging
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from typing import Final

from adapters.mal import MalUri
from adapters.mrs.aboard import (
    FileManagementService,
    Gateway,
    MonitoringService,
    NotificationService,
    PlanService,
    ServedOperations,
    past_notifications,
    serve_commands,
    serve_events,
    serve_files,
    serve_state,
)
from adapters.mrs.fleet import FleetService
from adapters.mrs.spec import PORT
from adapters.mrs.terms import CLEAR, Terms
from executive.reports import PlanUpdate, Report
from executive.runner import Executive
from executive.settings import Settings
from executive.state import FileEvent, ParameterValue

_LOG: Final = logging.getLogger(__name__)


class MrsLink:
    """Takes commands and questions to an executive, and sends its reports and telemetry.

    It implements `executive.ports.Downlink`: `report` and `telemetry` only hand over to the link's
    thread. What comes while the link does not run is not sent; clients catch up by
    `getNotifications`.

    Args:
        host: the address to listen on; `0.0.0.0` for every network.
        port: the port to listen on; 0 for a free one.
        clear_text: whether others than this computer may be served without certificates.
        terms: the encoding and the certificates agreed on with the ground.
        service_layer: where another service layer is, to be registered at; None for nowhere.
    """

    def __init__(
        self,
        settings: Settings,
        host: str = "127.0.0.1",
        port: int = PORT,
        clear_text: bool = False,
        terms: Terms = CLEAR,
        service_layer: MalUri | None = None,
    ) -> None:
        """Prepare; nobody listens yet."""
        self._settings = settings
        self._address = (host, port)
        self._clear_text = clear_text
        self._terms = terms
        self._service_layer = service_layer
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._end: Callable[[], None] = lambda: None
        self._notification: NotificationService | None = None
        self._monitoring: MonitoringService | None = None
        self._files: FileManagementService | None = None
        self._plans: PlanService | None = None

    def start(self, executive: Executive) -> MalUri:
        """Serve an executive; its core must be served by another thread from now on.

        Returns:
            Where the MRS is served.

        Raises:
            CertificateError: a certificate file cannot be used.
            OSError: the address cannot be had.
            ValueError: others can reach the address, and there are neither certificates nor
                `clear_text`.
        """
        listening: Future[MalUri] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(executive, listening), name="mrs", daemon=True
        )
        self._thread.start()
        return listening.result()

    def close(self) -> None:
        """Hang up on everybody and stop listening."""
        if self._thread is not None:
            self._end()
            self._thread.join()
            self._thread = None

    def report(self, report: Report) -> None:
        """Send a report to whoever subscribed."""
        if self._notification is not None:
            self._post(self._notification.publish, report)

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Send parameter values to whoever subscribed."""
        if self._monitoring is not None:
            self._post(self._monitoring.publish, values)

    def file(self, event: FileEvent) -> None:
        """Send what happened to a file to whoever subscribed."""
        if self._files is not None:
            found = self._files.look(event.path)
            self._post(self._files.watch.hear, event.kind, event.path, *found)

    def plan(self, update: PlanUpdate) -> None:
        """Send how far a plan has come to whoever subscribed."""
        if self._plans is not None:
            self._post(self._plans.publish, update)

    def _post(self, act: Callable[..., None], *arguments: object) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop is closed: nobody is there to hear
                self._loop.call_soon_threadsafe(act, *arguments)

    def _run(self, executive: Executive, listening: "Future[MalUri]") -> None:
        try:
            asyncio.run(self._serve(executive, listening))
        except Exception as error:
            if listening.done():
                _LOG.exception("the direct link is down")
            else:
                listening.set_exception(error)

    def _put_up(self, offer: ServedOperations, core: Gateway, fleet: FleetService) -> None:
        """Serve what this link serves: a line for each group of operations."""
        serve_commands(offer, core)
        serve_state(offer, core)
        settings, past = self._settings, partial(past_notifications, core)
        self._notification = NotificationService(
            offer, past, settings.asset, settings.domain, fleet.notification
        )
        serve_events(offer, core)
        self._monitoring = MonitoringService(offer, core, self._settings, fleet.value)
        self._plans = PlanService(offer, core, self._settings)

    async def _serve(self, executive: Executive, listening: "Future[MalUri]") -> None:
        loop = asyncio.get_running_loop()
        tls, over = self._terms.for_provider(), asyncio.Event()
        offer, core = ServedOperations(self._terms.encoding), Gateway(executive, loop)
        fleet = FleetService(offer, core, self._settings, self._terms)
        self._put_up(offer, core, fleet)
        self._files = serve_files(offer, executive.files, self._settings)
        await offer.provider.start(*self._address, tls, self._clear_text)
        self._loop = loop
        self._end = lambda: self._post(over.set)
        listening.set_result(offer.provider.uri)
        if self._service_layer is not None:
            fleet.join(self._service_layer)
        await over.wait()
        await fleet.leave()
        await offer.provider.close()
