"""The behaviour tree of a rover, put together from what it broadcasts of it."""

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
    """The streams of the behaviour tree: what differs is passed on as the whole that it makes.

    What differs from a whole that did not come is passed over; another whole comes soon.
    """

    def __init__(self) -> None:
        super().__init__("Status", "monitorTree")
        self._number = 0
        self._whole: TreeSnapshot | None = None

    async def subscribe(self, consumer: RoverConsumer) -> None:
        """Subscribe over a connection, over which a whole comes first, if anybody listens."""
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
            _LOG.warning("a tree was told that is none: %s", error)
            return
        if is_whole:
            self._number, self._whole = update.whole, snapshot
        self.put(snapshot)
