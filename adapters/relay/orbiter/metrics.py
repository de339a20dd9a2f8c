"""`collect` adds the metrics of the orbiter to a page: for each rover its commands and its link."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Final

from adapters.relay.orbiter.link_status import LINK_PARAMETERS, RelayLinkStatus
from adapters.relay.orbiter.provider import RoverProvider
from adapters.system import OPERATING_SYSTEM

if TYPE_CHECKING:
    from adapters.metrics.exposition import Scrape

_NAMES: Final = {
    "DTN_QUEUED": "bundles_queued",
    "DTN_OLDEST_AGE": "oldest_command_age_seconds",
    "DTN_LAST_RECEIVED": "last_received_age_seconds",
    "DTN_SENT": "bundles_sent_total",
    "DTN_RETRANSMITTED": "retransmissions_total",
    "DTN_EXPIRED": "bundles_expired_total",
    "DTN_RECEIVED": "bundles_received_total",
    "DTN_ROUND_TRIP": "round_trip_seconds",
}
_TEXTS: Final = {each.name: each.description for each in LINK_PARAMETERS}


def collect(
    statuses: Callable[[], Iterable[RelayLinkStatus | None]],
    providers: Sequence[RoverProvider],
    folder: Path,
    scrape: "Scrape",
) -> None:
    """Add the metrics to a page; the state of the links is that of the last second."""
    for status, provider in zip(statuses(), providers, strict=True):
        scrape.labels = {"asset": provider.asset}
        values = () if status is None else status.values(0.0)
        figures = {each.name: each.value.value for each in values if each.value is not None}
        contact = None if status is None else status.contact
        scrape.add("link_contact", "1 while sending is possible", contact)
        scrape.table(_NAMES, _TEXTS, figures)
        scrape.reports(provider.reports)
        text = "Commands reported as lost; a late report may still end them"
        scrape.add("lost_commands_total", text, provider.reports.lost)
        scrape.stores(folder, provider.asset)
    scrape.labels = {}
    scrape.stores(folder, "bundles")
    with suppress(OSError):
        text = "Free space on the disk of the data"
        scrape.add("disk_free_bytes", text, OPERATING_SYSTEM.free_octets(folder))
