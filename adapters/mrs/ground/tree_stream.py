"""The behaviour tree of a rover, assembled from its updates."""

import logging
from typing import TYPE_CHECKING, Final

from adapters.mal import UpdateHeader
from adapters.mrs.ground.notification_stream import Updates
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.spec import TreeUpdate

if TYPE_CHECKING:
    from trees import TreeSnapshot

_LOG: Final = logging.getLogger(__name__)


class TreeUpdates(Updates["TreeSnapshot"]):
    """The streams of the behaviour tree: differences are merged into the full tree.

    Differences from a missed full update are skipped until the next full one.
    """

    def __init__(self) -> None:
        super().__init__("Status", "monitorTree")
        self._number = 0
        self._whole: TreeSnapshot | None = None

    async def subscribe(self, consumer: RoverConsumer) -> None:
        """Subscribe over a connection, if a stream is open; the first update is a full one."""
        self._whole = None
        await super().subscribe(consumer)

    def _on_update(self, _: UpdateHeader, update: TreeUpdate) -> None:
        from adapters.mrs.spec.tree_updates import snapshot_of_update

        is_whole = update.nodes is not None
        if not is_whole and (self._whole is None or update.whole != self._number):
            return
        try:
            snapshot = snapshot_of_update(update, self._whole)
        except ValueError as error:
            _LOG.warning("invalid tree update: %s", error)
            return
        if is_whole:
            self._number, self._whole = update.whole, snapshot
        self.put(snapshot)
