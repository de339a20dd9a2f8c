"""`SessionAuthority`: requests the command authority for a client's session, and renews it."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, Final

from adapters.mal import MalError
from adapters.mrs.spec import AuthorityStatus

RENEWALS: Final = 3
"""Renewals within the time of a lease, so that one lost answer does not end it."""

SendAuthorityRequest = Callable[..., Awaitable[AuthorityStatus]]


class SessionAuthority:
    """Requests the authority of a rover, and renews it.

    Its methods raise MalError if the rover refuses, with the holder's name, and ConnectionError if
    the link does not recover in time.

    Args:
        send_request: calls an operation of the service Authority.
        renews: whether to renew the lease periodically; otherwise only each request renews it.

    Attributes:
        epoch: epoch of the authority that commands claim; None for no claim.
    """

    def __init__(
        self, send_request: SendAuthorityRequest, source: str, *, renews: bool = True
    ) -> None:
        self._send_request = send_request
        self._renews = renews
        self.source = source
        self.epoch: int | None = None
        self._renewing: asyncio.Task[None] | None = None

    async def status(self) -> AuthorityStatus:
        """Return the status of the authority, with its holder."""
        return await self._send_request("getAuthority")

    async def ensure(self) -> None:
        """Request the authority if commands need it; ignored if the rover lacks the service."""
        try:
            status = await self.status()
        except MalError:
            return
        if status.needed:
            await self.request()

    async def request(self) -> AuthorityStatus:
        """Request the authority. If another source holds it, its holder is notified."""
        return self._held(await self._send_request("requestAuthority", self.source))

    async def take(self) -> AuthorityStatus:
        """Take the authority over from its holder, if the rover's settings allow this source to."""
        return self._held(await self._send_request("takeAuthority", self.source))

    async def hand_over(self, to: str, lease_s: float | None = None) -> AuthorityStatus:
        """Hand the authority over, with a lease in s; None for the default lease."""
        epoch = (await self.request()).epoch
        status = await self._send_request("handOver", self.source, epoch, to, lease_s)
        self.detach()
        return status

    async def release(self) -> AuthorityStatus:
        """Release the authority."""
        epoch = self.epoch if self.epoch is not None else (await self.status()).epoch
        status = await self._send_request("releaseAuthority", self.source, epoch)
        self.detach()
        return status

    def detach(self) -> None:
        """Stop claiming and renewing it; it ends with its lease."""
        self.epoch = None
        if self._renewing is not None:
            self._renewing.cancel()
            self._renewing = None

    async def wait_lost(self) -> None:
        """Wait until the authority is lost."""
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
                status: Any = await self._send_request("requestAuthority", self.source)
                self.epoch, lease_s = status.epoch, status.lease
        except (MalError, ConnectionError):
            self.epoch = self._renewing = None
