"""`MrsLink`: onboard end of the direct link; serves the MRS over MAL on its own thread."""

import asyncio
import logging
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Protocol

from adapters.mal import LinkTraffic, MalError, MalUri
from adapters.mrs.aboard import (
    AssetServices,
    CoreGateway,
    FileServices,
    HistoryService,
    PlanCheckService,
    PreviewService,
    ServedOperations,
    TreeService,
    serve_authority,
)
from adapters.mrs.fleet import FleetService
from adapters.mrs.spec import PORT, HousekeepingParameter, housekeeping_values
from adapters.mrs.transport import CLEAR, TransportSettings
from adapters.system import OPERATING_SYSTEM, System
from executive.core.runner import Executive
from executive.history.history_builder import HistoryBuilder
from executive.settings import Settings
from executive.values.parameters import ParameterValue
from executive.values.reports import FileEvent, PlanUpdate, Report

_LOG: Final = logging.getLogger(__name__)
HOUSEKEEPING_S: Final = 5.0
"""Period of the housekeeping telemetry; chosen, not measured."""


@dataclass(frozen=True, slots=True)
class _Serving:
    """Objects that exist while the link runs."""

    gateway: CoreGateway
    asset: AssetServices
    files: FileServices
    end: Callable[[], None]


def _holder(executive: Executive) -> str | None:
    return executive.authority.state.holder


class HousekeepingSource(Protocol):
    """Measures the housekeeping of the onboard processes."""

    parameters: tuple[HousekeepingParameter, ...]

    def measure(self, executive: Executive) -> Mapping[str, float | None]:
        """Return figures by parameter name, None if unknown; called on the core's thread."""


async def _publish_housekeeping(
    gateway: CoreGateway, asset: AssetServices, housekeeping: HousekeepingSource
) -> None:
    def measured(executive: Executive) -> tuple[float, Mapping[str, float | None]]:
        """Return figures with their time, from the clock that also stamps event reports."""
        return executive.parameters()[0].utc_s, housekeeping.measure(executive)

    while True:
        with suppress(MalError):  # the core is busy: the values become stale, visibly
            utc_s, figures = await gateway.query(measured)
            asset.publish_housekeeping(housekeeping_values(housekeeping.parameters, figures, utc_s))
        await asyncio.sleep(HOUSEKEEPING_S)


class MrsLink:
    """Passes commands and queries to an executive, and sends its reports and telemetry.

    It implements `executive.values.ports.Downlink`: `send_reports` and `send_telemetry` only pass
    their argument to the link's thread. While the link does not run nothing is sent; clients catch
    up by `getNotifications`.

    Args:
        host: the address to listen on; `0.0.0.0` for every network.
        port: the port to listen on; 0 for a free one.
        clear_text: whether clients on other hosts are served without certificates.
        terms: encoding and certificates, the same at both ends.
        service_layer: address of another service layer to register at; None for no registration.
        history: recorded history of the executive for `getHistory`; None if it records nothing.
        housekeeping: measures the onboard processes; None for no housekeeping.
        recordings: folder of the executive's recordings, which clients can fetch; None for none.
        system: clock of messages, and sockets.

    Attributes:
        traffic: traffic of its clients; None before the start.
    """

    def __init__(
        self,
        settings: Settings,
        host: str = "127.0.0.1",
        port: int = PORT,
        clear_text: bool = False,
        terms: TransportSettings = CLEAR,
        service_layer: MalUri | None = None,
        history: HistoryBuilder | None = None,
        housekeeping: HousekeepingSource | None = None,
        recordings: Path | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._settings = settings
        self._address = (host, port)
        self._clear_text = clear_text
        self._terms = terms
        self._service_layer = service_layer
        self._history = history
        self._housekeeping = housekeeping
        self._recordings = recordings
        self._system = system
        self._thread: threading.Thread | None = None
        self._serving: _Serving | None = None
        self.traffic: LinkTraffic | None = None

    def start(self, executive: Executive) -> MalUri:
        """Serve an executive, whose core must run on another thread from now on.

        Returns:
            The URI of the MRS.

        Raises:
            CertificateError: a certificate file cannot be used.
            OSError: the address is not available.
            ValueError: other hosts can reach the address, but there are neither certificates nor
                `clear_text`.
        """
        listening: Future[MalUri] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(executive, listening), name="mrs", daemon=True
        )
        self._thread.start()
        return listening.result()

    def close(self) -> None:
        """Close all connections and stop listening."""
        if self._thread is not None:
            if self._serving is not None:
                self._serving.gateway.call_on_loop(self._serving.end)
            self._thread.join()
            self._thread = None

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Send reports to their subscribers."""
        if self._serving is not None:
            self._serving.gateway.call_on_loop(self._serving.asset.report, reports)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Send parameter values to their subscribers."""
        if self._serving is not None:
            self._serving.gateway.call_on_loop(self._serving.asset.publish_telemetry, values)

    def send_file_event(self, event: FileEvent) -> None:
        """Send a file event to its subscribers."""
        if self._serving is not None:
            files = self._serving.files
            found = files.inspect(event.path)
            self._serving.gateway.call_on_loop(files.watch.notify, event.kind, event.path, *found)

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Send the status of a plan to its subscribers."""
        if self._serving is not None:
            self._serving.gateway.call_on_loop(self._serving.asset.publish_plan_update, update)

    def _run(self, executive: Executive, listening: "Future[MalUri]") -> None:
        try:
            asyncio.run(self.serve(executive, listening))
        except Exception as error:
            if listening.done():
                _LOG.exception("the direct link is down")
            else:
                listening.set_exception(error)

    async def serve(self, executive: Executive, listening: "Future[MalUri]") -> None:
        """Serve an executive on the running loop until it is closed.

        Args:
            executive: executive, which runs on another thread.
            listening: completes with the URI of the MRS.
        """
        settings, over = self._settings, asyncio.Event()
        tls = self._terms.for_provider()
        served = ServedOperations(
            self._terms.encoding, executive.ground.record_contact, self._system
        )
        gateway = CoreGateway(executive, asyncio.get_running_loop())
        housekeeping = self._housekeeping
        parameters = () if housekeeping is None else housekeeping.parameters
        asset = AssetServices(served, gateway, settings, parameters)
        fleet = FleetService(served, gateway, asset, settings, self._terms, self._system)
        PreviewService(served, gateway)
        PlanCheckService(served, settings)
        TreeService(served, gateway, settings)
        if self._history is not None:
            HistoryService(served, gateway, self._history)
        serve_authority(served, gateway)
        files = FileServices(
            *(served, executive.files, settings, partial(gateway.query, _holder)),
            *(self._recordings, self._system),
        )
        await served.provider.start(*self._address, tls, self._clear_text)
        self._serving = _Serving(gateway, asset, files, over.set)
        self.traffic = served.provider.traffic
        listening.set_result(served.provider.uri)
        if self._service_layer is not None:
            fleet.join(self._service_layer)
        task = None
        if housekeeping is not None:
            task = asyncio.create_task(_publish_housekeeping(gateway, asset, housekeeping))
        await over.wait()
        if task is not None:
            task.cancel()
        await fleet.leave()
        await served.provider.close()
