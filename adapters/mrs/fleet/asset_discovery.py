"""Asks other assets at their own addresses what they are and which mode they are in."""

import asyncio
import logging
from dataclasses import dataclass, replace
from typing import Final

from adapters.mal import MalError
from adapters.mrs.fleet.known_assets import KnownAsset
from adapters.mrs.ground import Dialer
from adapters.mrs.spec import AssetInfo, AssetMode
from adapters.mrs.terms import Terms

_LOG: Final = logging.getLogger(__name__)

FRESH_S: Final = 1.0
"""An answer younger than this is given again."""
ANSWER_TIMEOUT_S: Final = 2.0
"""Whoever takes longer to answer is OFFLINE."""
MOST_DOMAIN: Final = 16
LONGEST_TEXT: Final = 256


@dataclass(frozen=True, slots=True)
class _Answer:
    info: AssetInfo
    at_s: float


class AssetDiscovery:
    """Asks each asset at its own address, and caches the answers.

    Args:
        name: what this end calls itself.
        terms: on which others are spoken to.
    """

    def __init__(self, name: str, terms: Terms) -> None:
        self._dialer = Dialer(name, terms, ANSWER_TIMEOUT_S)
        self._answers: dict[str, _Answer] = {}
        self._asking: dict[str, asyncio.Task[AssetInfo]] = {}

    async def ask(self, others: tuple[KnownAsset, ...]) -> tuple[AssetInfo, ...]:
        """Return what each of the others is; OFFLINE where none answers."""
        for gone in self._answers.keys() - {other.asset for other in others}:
            del self._answers[gone]
        return tuple(await asyncio.gather(*map(self._one, others)))

    async def _one(self, other: KnownAsset) -> AssetInfo:
        answer = self._answers.get(other.asset)
        now_s = asyncio.get_running_loop().time()
        if answer is not None and now_s - answer.at_s < FRESH_S:
            return answer.info
        task = self._asking.get(other.asset)
        if task is None:
            task = self._asking[other.asset] = asyncio.create_task(self._discover(other))
            task.add_done_callback(lambda _: self._asking.pop(other.asset))
        return await asyncio.shield(task)

    async def _discover(self, other: KnownAsset) -> AssetInfo:
        try:
            async with asyncio.timeout(ANSWER_TIMEOUT_S):
                info = await self._get(other)
        except (MalError, OSError, ValueError) as fault:
            _LOG.debug("%s does not answer: %s", other.asset, fault)
            info = self._offline(other.asset)
        self._answers[other.asset] = _Answer(info, asyncio.get_running_loop().time())
        return info

    async def _get(self, other: KnownAsset) -> AssetInfo:
        if other.uri is None:
            raise ValueError("its address is not known")
        consumer = await self._dialer.connect(other.uri)
        try:
            info: AssetInfo
            (info,) = await consumer.request("ServiceLayer", "getAsset")
        finally:
            await consumer.close()
        if info.asset != other.asset or not _is_valid(info):
            raise ValueError(f"{info.asset[:LONGEST_TEXT]} answers at its address")
        return info

    def _offline(self, asset: str) -> AssetInfo:
        known = self._answers.get(asset)
        if known is not None:
            return replace(known.info, mode=AssetMode.OFFLINE)
        return AssetInfo(
            asset=asset, domain=(), description="", softwareVersion="", mode=AssetMode.OFFLINE
        )


def _is_valid(info: AssetInfo) -> bool:
    texts = (info.description, info.softwareVersion, *info.domain)
    return len(info.domain) <= MOST_DOMAIN and all(len(text) <= LONGEST_TEXT for text in texts)
