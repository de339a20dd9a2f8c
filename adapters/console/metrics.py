"""`MetricsRequests` serves the metrics of the console, by the access rules of its data."""

from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.archive import Archive
from adapters.console.housekeeping import ConsoleHousekeeping
from adapters.console.messages import CommandStatus, LinkState
from adapters.console.rovers import LINK_HOUSEKEEPING, Fleet
from adapters.metrics import ReportCounter
from adapters.metrics.exposition import CONTENT_TYPE, Exposition, Scrape
from adapters.mrs.spec import CONSOLE_HOUSEKEEPING
from adapters.system import System
from executive.values.reasons import Reason, UnknownReason

_NAMES: Final = {
    "CONSOLE_PAGES": "pages",
    "CONSOLE_DROPPED": "dropped_values_total",
    "CONSOLE_QUEUED": "archive_queued",
    "CONSOLE_LOST": "archive_lost_messages_total",
    "CONSOLE_DISK_FREE": "disk_free_bytes",
    "LINK_ROUND_TRIP": "link_round_trip_seconds",
    "LINK_CLOCK_OFFSET": "link_clock_offset_seconds",
}


def count_command(counter: ReportCounter, command: CommandStatus) -> None:
    """Count a command that ends, if it was open before."""
    if not command.ended:
        counter.begin(command.id, command.name)
    elif counter.knows(command.id):
        counter.end(command.id, command.state.name, _reason(command.history[-1].code))


def _reason(code: int | None) -> Reason | UnknownReason | None:
    try:
        return None if code is None else Reason(code)
    except ValueError:
        return UnknownReason(code or 0)


class MetricsRequests:
    """Serves the page.

    Args:
        fleet, archive, housekeeping: their state is shown.
        commands: counts the ends of commands.
        folder: folder of an archive in a file; None for another database.
        system: clock.
    """

    def __init__(
        self,
        fleet: Fleet,
        archive: Archive,
        housekeeping: ConsoleHousekeeping,
        commands: ReportCounter,
        folder: Path | None,
        system: System,
    ) -> None:
        self._fleet, self._archive, self._housekeeping = fleet, archive, housekeeping
        self._commands, self._folder, self._system = commands, folder, system
        self._exposition = Exposition("console", self._collect, system)

    def routes(self) -> list[web.RouteDef]:
        """Return the route."""
        return [web.get("/metrics", self._page)]

    async def _page(self, _: web.Request) -> web.Response:
        headers = {"Content-Type": CONTENT_TYPE}
        return web.Response(body=self._exposition.page(), headers=headers)

    def _collect(self, scrape: Scrape) -> None:
        scrape.reports(self._commands)
        for asset, known in self._fleet.assets.items():
            for kind, link in known.links.items():
                scrape.labels = {"asset": asset, "link": kind.value}
                scrape.add("link_up", "1 while it answers", link.state is LinkState.UP)
                text, last_s = "Time since the last reception", link.last_received_s
                age_s = None if last_s is None else self._system.utc_s() - last_s
                scrape.add("link_last_received_age_seconds", text, age_s)
                scrape.table(_NAMES, LINK_HOUSEKEEPING, link.figures)
        scrape.labels = {}
        scrape.table(_NAMES, CONSOLE_HOUSEKEEPING, self._housekeeping.figures)
        text = "Telemetry values written to the archive since the start"
        scrape.add("archive_values_total", text, self._archive.samples)
        if self._folder is not None:
            scrape.stores(self._folder, "archive")
