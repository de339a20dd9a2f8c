"""The authority of a session: asked for, renewed while the session lasts, claimed by commands."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

from adapters.mal import MalError
from adapters.mrs.spec import AuthorityStatus

RENEWALS: Final = 3
"""How often a lease is renewed within its time, so that one lost answer does not end it."""

Ask = Callable[..., Awaitable[AuthorityStatus]]


class SessionAuthority:
    """Asks a rover for the authority, and keeps it.

    Its methods raise MalError where the rover refuses, naming the holder, and ConnectionError when
    the rover does not come back in time.

    Args:
        ask: calls an operation of the service Authority.
        source: who commands.
        renews: whether to keep it; else each request of its own renews the lease.

    Attributes:
        source: who commands.
        epoch: of the authority that commands claim; None for no claim.
    """

    def __init__(self, ask: Ask, source: str, *, renews: bool = True) -> None:
        self._ask = ask
        self._renews = renews
        self.source = source
        self.epoch: int | None = None
        self._renewing: asyncio.Task[None] | None = None

    async def status(self) -> AuthorityStatus:
        """Return who holds it."""
        return await self._ask("getAuthority")

    async def ensure(self) -> None:
        """Request it where commands need it; nothing where a rover serves no such thing."""
        try:
            status = await self.status()
        except MalError:
            return
        if status.needed:
            await self.request()

    async def request(self) -> AuthorityStatus:
        """Get it if nobody else holds it; else its holder hears who asks."""
        return self._held(await self._ask("requestAuthority", self.source))

    async def take(self) -> AuthorityStatus:
        """Take it from whoever holds it, if the rover's settings let this source."""
        return self._held(await self._ask("takeAuthority", self.source))

    async def hand_over(self, to: str, lease_s: float | None = None) -> AuthorityStatus:
        """Give it to another, who may be silent for so long; None for as long as everybody."""
        epoch = (await self.request()).epoch
        status = await self._ask("handOver", self.source, epoch, to, lease_s)
        self.let_go()
        return status

    async def release(self) -> AuthorityStatus:
        """Give it up."""
        epoch = self.epoch if self.epoch is not None else (await self.status()).epoch
        status = await self._ask("releaseAuthority", self.source, epoch)
        self.let_go()
        return status

    def let_go(self) -> None:
        """Claim it and renew it no more; it ends with its lease."""
        self.epoch = None
        if self._renewing is not None:
            self._renewing.cancel()
            self._renewing = None

    async def lost(self) -> None:
        """Return when it is held no more."""
        if self._renewing is not None:
            await asyncio.wait((self._renewing,))

    def _held(self, status: AuthorityStatus) -> AuthorityStatus:
        self.epoch = status.epoch
        if self._renews and self._renewing is None:
            self._renewing = asyncio.create_task(self._renew(status.lease))
        return status

    async def _renew(self, lease_s: float) -> None:
        try:
            while True:
                await asyncio.sleep(lease_s / RENEWALS)
                status: Any = await self._ask("requestAuthority", self.source)
                self.epoch, lease_s = status.epoch, status.lease
        except (MalError, ConnectionError):
            self.epoch = self._renewing = None
