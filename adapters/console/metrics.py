"""`metrics_routes` serves the metrics of the console, by the access rules of its data."""

from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.archive import Archive
from adapters.console.housekeeping import ConsoleHousekeeping
from adapters.console.messages import LinkState
from adapters.console.rovers import LINK_HOUSEKEEPING, Fleet
from adapters.metrics.exposition import CONTENT_TYPE, Exposition, Scrape
from adapters.mrs.spec import CONSOLE_HOUSEKEEPING
from adapters.system import System

_NAMES: Final = {
    "CONSOLE_PAGES": "pages",
    "CONSOLE_DROPPED": "dropped_values_total",
    "CONSOLE_QUEUED": "archive_queued",
    "CONSOLE_LOST": "archive_lost_messages_total",
    "CONSOLE_DISK_FREE": "disk_free_bytes",
}
_LINK_NAMES: Final = {"LINK_ROUND_TRIP": "link_round_trip_seconds"}
_PARAMETERS: Final = (*CONSOLE_HOUSEKEEPING, *LINK_HOUSEKEEPING)
_TEXTS: Final = {each.name: each.description for each in _PARAMETERS}


def metrics_routes(
    fleet: Fleet, archive: Archive, housekeeping: ConsoleHousekeeping, folder: Path, system: System
) -> list[web.RouteDef]:
    """Return the route of the metrics of links, pages, and the archive in a data folder."""

    def collect(scrape: Scrape) -> None:
        for asset, known in fleet.assets.items():
            for kind, link in known.links.items():
                scrape.labels = {"asset": asset, "link": kind.value}
                scrape.add("link_up", "1 while it answers", link.state is LinkState.UP)
                scrape.table(_LINK_NAMES, _TEXTS, link.figures)
        scrape.labels = {}
        scrape.table(_NAMES, _TEXTS, housekeeping.figures)
        text = "Telemetry values written to the archive since the start"
        scrape.add("archive_values_total", text, archive.samples)
        scrape.stores(folder, "archive")

    page = Exposition("console", collect, system).page

    async def answer(_: web.Request) -> web.Response:
        return web.Response(body=page(), headers={"Content-Type": CONTENT_TYPE})

    return [web.get("/metrics", answer)]
