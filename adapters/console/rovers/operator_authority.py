"""`OperatorAuthority` requests, renews and hands over an asset's authority for the operators.

The asset grants the authority. Operators use their own names as sources, unless the console's
certificate proves one name for all: then the console holds it for one operator at a time.
"""

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from http import HTTPStatus
from typing import Final, assert_never

from adapters.console.messages import AuthorityMessage, LinkKind
from adapters.console.rovers.rover_link import RoverLink
from adapters.console.web import RequestError, refused
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AuthorityStatus, describe_error
from executive.core.authority import AuthorityAction, AuthorityRequest

_LOG: Final = logging.getLogger(__name__)

RENEW_BELOW: Final = 2 / 3
"""Share of a lease below which it is renewed, so that one lost answer does not end it."""
CHECK_S: Final = 1.0
RENEWAL_S: Final = 0.5
"""Change of a lease's end from which on it is published again, s."""

Key = tuple[str, LinkKind]


class OperatorAuthority:
    """Requests the authority for operators, and renews it while they have a page open.

    Args:
        publish: sends the status of the authority to all pages.
        is_present: whether an operator has a page open.
        utc: clock, s since 1970 UTC.
    """

    def __init__(
        self,
        publish: Callable[[AuthorityMessage], None],
        is_present: Callable[[str], bool],
        utc: Callable[[], float],
    ) -> None:
        self._publish = publish
        self._is_present = is_present
        self._utc = utc
        self._held: dict[Key, AuthorityMessage] = {}
        self._links: dict[Key, RoverLink] = {}
        self._for: dict[Key, str] = {}
        self._pending: dict[Key, str] = {}

    @property
    def held(self) -> tuple[AuthorityMessage, ...]:
        """The last received authority of each asset and link."""
        return tuple(self._held.values())

    def source(self, link: RoverLink, operator: str) -> str:
        """Return the source of an operator's commands over a link."""
        return link.proven_name or operator

    def client(self, link: RoverLink) -> MrsClient:
        """Return the session of a link.

        Raises:
            RequestError: it is down.
        """
        if link.client is None:
            text = f"{link.asset} cannot be reached: nothing was sent; try again when it is up"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text)
        return link.client

    def claim(self, link: RoverLink, operator: str) -> int | None:
        """Return the epoch that an operator's command claims; None if it needs none.

        Raises:
            RequestError: a command needs the authority, and the operator does not hold it.
        """
        held = self._held.get(_key(link))
        if held is None:
            return None
        if held.operator == operator:
            return held.epoch
        if not held.needed:
            return None
        raise self._not_held(held, f"{operator} does not hold the authority over {held.asset}")

    def on_status(self, link: RoverLink, status: AuthorityStatus) -> AuthorityMessage:
        """Store the authority status of an asset; publish it if it has changed."""
        key = _key(link)
        self._links[key] = link
        before = self._held.get(key)
        if before is not None and before.epoch != status.epoch:
            self._pending.pop(key, None)
        operator = status.holder
        if link.proven_name is not None and status.holder == link.proven_name:
            operator = self._for.get(key)
        held = AuthorityMessage(
            asset=link.asset,
            link=link.kind,
            utc=self._utc(),
            holder=status.holder,
            operator=operator,
            epoch=status.epoch,
            needed=status.needed,
            lease_left=status.leaseLeft,
            lease=status.lease,
            requested_by=self._pending.get(key) or status.requestedBy,
        )
        self._held[key] = held
        if before is None or _is_worth_publishing(before, held):
            self._publish(held)
        return held

    async def request(self, link: RoverLink, request: AuthorityRequest) -> AuthorityMessage:
        """Perform the action that an operator requests; the source is the operator.

        Raises:
            RequestError: another operator holds it, or the asset cannot be reached.
        """
        _LOG.info("%s: %s: %s %s", link.asset, request.source, request.act.value, request.to)
        self._require_turn(link, request)
        try:
            status = await self._perform(link, request)
        except MalError as error:
            raise await self._refused(link, error) from error
        except ConnectionError as error:
            text = f"{link.asset} cannot be reached: {error}"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error
        return self.on_status(link, status)

    async def run(self) -> None:
        """Renew the leases of operators with an open page periodically."""
        while True:
            await asyncio.sleep(CHECK_S)
            for key, held in tuple(self._held.items()):
                if held.operator is None or not self._is_present(held.operator):
                    continue
                left_s = held.utc + held.lease_left - self._utc()
                if left_s < RENEW_BELOW * held.lease:
                    await self._renew(self._links[key], held.operator)

    async def _renew(self, link: RoverLink, operator: str) -> None:
        if link.client is None:
            return
        authority = link.client.authority_of(self.source(link, operator))
        try:
            self.on_status(link, await authority.request())
        except (MalError, ConnectionError) as error:
            _LOG.warning("%s: the authority of %s is not renewed: %s", link.asset, operator, error)

    async def _perform(self, link: RoverLink, request: AuthorityRequest) -> AuthorityStatus:
        authority = self.client(link).authority_of(self.source(link, request.source))
        key = _key(link)
        match request.act:
            case AuthorityAction.REQUEST | AuthorityAction.TAKE:
                take = request.act is AuthorityAction.TAKE
                status = await (authority.take() if take else authority.request())
                self._for[key] = request.source
            case AuthorityAction.HAND_OVER:
                if link.proven_name is not None and self._is_present(request.to):
                    status = await authority.request()
                    self._for[key] = request.to
                    self._pending.pop(key, None)
                else:
                    status = await authority.hand_over(request.to, request.lease_s)
            case AuthorityAction.RELEASE:
                status = await authority.release()
                self._for.pop(key, None)
            case _:
                assert_never(request.act)
        return status

    def _require_turn(self, link: RoverLink, request: AuthorityRequest) -> None:
        """Raise RequestError if all operators share one source and another one holds it."""
        held = self._held.get(_key(link))
        if held is None or link.proven_name is None or held.holder != link.proven_name:
            return
        if held.operator in {None, request.source} or not self._is_present(held.operator):
            return
        if request.act in {AuthorityAction.REQUEST, AuthorityAction.TAKE}:
            self._pending[_key(link)] = request.source
            held = replace(held, requested_by=request.source)
            self._held[_key(link)] = held
            self._publish(held)
        raise self._not_held(held, f"{request.source} does not hold the authority")

    async def _refused(self, link: RoverLink, error: MalError) -> RequestError:
        """Return the refusal of the asset, with the present holder."""
        holder = None
        with suppress(MalError, ConnectionError, RequestError):
            holder = self.on_status(link, await self.client(link).authority.status()).holder
        return refused(HTTPStatus.FORBIDDEN, describe_error(error), holder=holder)

    def _not_held(self, held: AuthorityMessage, wrong: str) -> RequestError:
        holder = held.holder
        if holder is None:
            text = f"{wrong}: no operator holds it; request it first"
        else:
            left_s = max(held.utc + held.lease_left - self._utc(), 0.0)
            operator = "" if held.operator in {None, holder} else f" ({held.operator})"
            text = (
                f"{wrong}: {holder}{operator} holds it for another {left_s:.0f} s; request it,"
                " which notifies the holder"
            )
        return refused(HTTPStatus.FORBIDDEN, text, holder=held.operator or holder)


def _key(link: RoverLink) -> Key:
    return link.asset, link.kind


def _is_worth_publishing(before: AuthorityMessage, now: AuthorityMessage) -> bool:
    """Whether the authority differs by more than the passing of its lease."""
    ends_s = (before.utc + before.lease_left, now.utc + now.lease_left)
    renewed = now.holder is not None and abs(ends_s[1] - ends_s[0]) > RENEWAL_S
    return renewed or replace(now, utc=before.utc, lease_left=before.lease_left) != before
