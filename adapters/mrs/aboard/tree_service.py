"""`TreeService` broadcasts the behaviour tree while it has subscribers.

The core's thread returns a snapshot at each poll; the link's loop decides which update is sent, and
when. Without subscribers the core is not polled.
"""

import asyncio
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Final

from adapters.mal import MalError
from adapters.mrs.aboard.gateway import CoreGateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec.tree_updates import change_update, whole_update
from executive.core.runner import Executive
from executive.settings import Settings
from executive.values.reports import without_figures
from trees import TreeSnapshot, snapshot_of

POLL_S: Final = 0.2
FIGURES_ONLY_S: Final = 1.0
"""Minimum period of updates in which only figures of texts differ; nothing else depends on it."""
FULL_UPDATE_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class _LastBroadcast:
    """A snapshot that was broadcast, with its time by the loop's clock."""

    snapshot: TreeSnapshot
    at_s: float


class TreeService:
    """Serves `Status.monitorTree`."""

    def __init__(self, served: ServedOperations, gateway: CoreGateway, settings: Settings) -> None:
        self._gateway = gateway
        self._asset = settings.asset
        self._domain = settings.domain
        self._publisher = served.publisher("Status", "monitorTree", self._begin)
        self._publishing: asyncio.Task[None] | None = None
        self._number = 0
        self._whole: _LastBroadcast | None = None
        self._last: _LastBroadcast | None = None

    def _begin(self) -> None:
        """Send a full tree to the new subscriber."""
        self._whole = None
        if self._publishing is None or self._publishing.done():
            self._publishing = asyncio.create_task(self._broadcast())

    async def _broadcast(self) -> None:
        while self._publisher.has_subscribers:
            with suppress(MalError):  # the core is busy or hangs: skip this poll
                self._poll(await self._gateway.query(_snapshot))
            await asyncio.sleep(POLL_S)

    def _poll(self, snapshot: TreeSnapshot) -> None:
        """Broadcast the update that is due, if any."""
        now = _LastBroadcast(snapshot, asyncio.get_running_loop().time())
        whole, last, change = self._whole, self._last, None
        if whole is not None and last is not None and now.at_s - whole.at_s < FULL_UPDATE_S:
            if _same(last.snapshot, snapshot):
                return
            if now.at_s - last.at_s < FIGURES_ONLY_S and _same(
                _without_figures(last.snapshot), _without_figures(snapshot)
            ):
                return
            change = change_update(self._number, whole.snapshot, snapshot)
        if change is None:
            self._number += 1
            self._whole = now
        self._last = now
        self._publisher.publish(
            change or whole_update(self._number, snapshot),
            keys=(self._asset,),
            domain=self._domain,
            source=self._asset,
            droppable=True,
        )


def _snapshot(executive: Executive) -> TreeSnapshot:
    return snapshot_of(executive, executive.parameters()[0].utc_s)


def _same(one: TreeSnapshot, other: TreeSnapshot) -> bool:
    """Whether two snapshots are equal except for their times."""
    return replace(one, tick=other.tick, utc_s=other.utc_s) == other


def _without_figures(snapshot: TreeSnapshot) -> TreeSnapshot:
    """Return a snapshot without figures."""
    nodes = tuple(replace(each, message=without_figures(each.message)) for each in snapshot.nodes)
    return replace(snapshot, nodes=nodes, why=without_figures(snapshot.why))
