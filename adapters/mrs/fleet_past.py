"""What an asset said before, asked of the service layer that heard it."""

from collections.abc import AsyncIterator
from typing import Final

from adapters.mal import Consumer
from adapters.mrs.notification_client_service import SERVICE
from adapters.mrs.types import Notification

LAST: Final = 100
"""Notifications from before the first meeting that are asked for."""


async def missed(
    consumer: Consumer, asset: str, last: Notification | None
) -> AsyncIterator[Notification]:
    """Give what an asset said since the last notification that was heard, oldest first.

    Before anything was heard, and when its ledger is another now, that is the last it said.

    Args:
        consumer: connected with a service layer.
        asset: its name.
        last: the last notification heard.

    Raises:
        MalError: NotFound, the asset is not known there; any other answer that is an error.
    """
    known = False
    if last is not None:
        async for told in _since(consumer, asset, last.sequence):
            if not known and told != last:
                break
            if known:
                yield told
            known = True
    if not known:
        async for told in _since(consumer, asset, await _newest(consumer, asset) - LAST + 1):
            yield told


async def _since(consumer: Consumer, asset: str, sequence: int) -> AsyncIterator[Notification]:
    since = max(1, sequence)
    while page := await _page(consumer, asset, since, 0):
        for told in page:
            yield told
        if page[-1].sequence < since:
            return
        since = page[-1].sequence + 1


async def _newest(consumer: Consumer, asset: str) -> int:
    """Return the highest sequence number, 0 for none, by halving the range in which it lies."""
    at_least, below = 0, 1
    while page := await _page(consumer, asset, below, 1):
        at_least, below = page[0].sequence, 2 * page[0].sequence
    while below - at_least > 1:
        middle = (at_least + below) // 2
        page = await _page(consumer, asset, middle, 1)
        if page:
            at_least = page[0].sequence
        else:
            below = middle
    return at_least


async def _page(consumer: Consumer, asset: str, since: int, most: int) -> tuple[Notification, ...]:
    page: tuple[Notification, ...]
    (page,) = await consumer.request(SERVICE, "getNotifications", asset, since, most)
    return page
