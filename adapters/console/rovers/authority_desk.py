"""Who of the operators commands an asset: what they ask of its authority, and its renewal.

The authority is the asset's. Operators have their own names there, unless the console's certificate
proves one name for all of them: then the console holds it for one operator at a time.
"""

import asyncio
import logging
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum, unique
from http import HTTPStatus
from typing import Final, assert_never

from adapters.console.messages import AuthorityMessage, LinkKind
from adapters.console.rovers.rover_link import RoverLink
from adapters.console.web import RequestError, refused
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AuthorityStatus, describe_error

_LOG: Final = logging.getLogger(__name__)

RENEW_BELOW: Final = 2 / 3
"""Of a lease: it is renewed when less is left, so that one lost answer does not end it."""
CHECK_S: Final = 1.0
RENEWAL_S: Final = 0.5
"""A lease that ends so much later than was told is told anew."""

Key = tuple[str, LinkKind]


@unique
class OperatorAction(Enum):
    """What an operator may ask of the authority."""

    REQUEST = "request"
    TAKE = "take"
    HAND_OVER = "hand_over"
    RELEASE = "release"


@dataclass(frozen=True, slots=True)
class OperatorRequest:
    """What an operator asks of the authority over an asset.

    Attributes:
        to, lease_s: of `HAND_OVER`: to whom, and for how long that one may be silent; None for as
            long as everybody.
    """

    act: OperatorAction
    operator: str
    to: str = ""
    lease_s: float | None = None


class OperatorAuthority:
    """Asks for the authority on behalf of operators, and renews it while they are there.

    Args:
        publish: tells all pages who holds it.
        is_present: whether an operator has a page open.
        utc: the time.
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
        self._asked: dict[Key, str] = {}

    @property
    def held(self) -> tuple[AuthorityMessage, ...]:
        """Who commands what, as last heard."""
        return tuple(self._held.values())

    def source(self, link: RoverLink, operator: str) -> str:
        """Return the name under which an operator commands by a link."""
        return link.proven_name or operator

    def client(self, link: RoverLink) -> MrsClient:
        """Return the session of a link.

        Raises:
            RefusedError: it is down.
        """
        if link.client is None:
            text = f"{link.asset} cannot be reached now: nothing was sent; try again when it is up"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text)
        return link.client

    def claim(self, link: RoverLink, operator: str) -> int | None:
        """Return the epoch that an operator's command claims; None where it needs none.

        Raises:
            RefusedError: another holds the authority, or nobody, and a command needs it.
        """
        held = self._held.get(_key(link))
        if held is None:
            return None
        if held.operator == operator:
            return held.epoch
        if not held.needed:
            return None
        raise self._not_held(held, f"{operator} does not hold the authority over {held.asset}")

    def hear(self, link: RoverLink, status: AuthorityStatus) -> AuthorityMessage:
        """Take in what an asset says of it; tell it if it is news."""
        key = _key(link)
        self._links[key] = link
        before = self._held.get(key)
        if before is not None and before.epoch != status.epoch:
            self._asked.pop(key, None)
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
            asked_by=self._asked.get(key) or status.askedBy,
        )
        self._held[key] = held
        if before is None or _is_news(before, held):
            self._publish(held)
        return held

    async def ask(self, link: RoverLink, asked: OperatorRequest) -> AuthorityMessage:
        """Do what an operator asks.

        Raises:
            RefusedError: another holds it, or the asset cannot be reached.
        """
        _LOG.info("%s: %s asks: %s %s", link.asset, asked.operator, asked.act.value, asked.to)
        self._require_turn(link, asked)
        try:
            status = await self._perform(link, asked)
        except MalError as error:
            raise await self._refused(link, error) from error
        except ConnectionError as error:
            text = f"{link.asset} cannot be reached now: {error}"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error
        return self.hear(link, status)

    async def run(self) -> None:
        """Renew what operators hold who are there."""
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
            self.hear(link, await authority.request())
        except (MalError, ConnectionError) as error:
            _LOG.warning("%s: the authority of %s is not renewed: %s", link.asset, operator, error)

    async def _perform(self, link: RoverLink, asked: OperatorRequest) -> AuthorityStatus:
        authority = self.client(link).authority_of(self.source(link, asked.operator))
        key = _key(link)
        match asked.act:
            case OperatorAction.REQUEST | OperatorAction.TAKE:
                take = asked.act is OperatorAction.TAKE
                status = await (authority.take() if take else authority.request())
                self._for[key] = asked.operator
            case OperatorAction.HAND_OVER:
                if link.proven_name is not None and self._is_present(asked.to):
                    status = await authority.request()
                    self._for[key] = asked.to
                    self._asked.pop(key, None)
                else:
                    status = await authority.hand_over(asked.to, asked.lease_s)
            case OperatorAction.RELEASE:
                status = await authority.release()
                self._for.pop(key, None)
            case _:
                assert_never(asked.act)
        return status

    def _require_turn(self, link: RoverLink, asked: OperatorRequest) -> None:
        """Where all operators have one name at the asset, let one of them at a time hold it."""
        held = self._held.get(_key(link))
        if held is None or link.proven_name is None or held.holder != link.proven_name:
            return
        if held.operator in {None, asked.operator} or not self._is_present(held.operator):
            return
        if asked.act in {OperatorAction.REQUEST, OperatorAction.TAKE}:
            self._asked[_key(link)] = asked.operator
            held = replace(held, asked_by=asked.operator)
            self._held[_key(link)] = held
            self._publish(held)
        raise self._not_held(held, f"{asked.operator} does not hold the authority")

    async def _refused(self, link: RoverLink, error: MalError) -> RequestError:
        """Return the refusal of the asset, with who holds it now."""
        holder = None
        with suppress(MalError, ConnectionError, RequestError):
            holder = self.hear(link, await self.client(link).authority.status()).holder
        return refused(HTTPStatus.FORBIDDEN, describe_error(error), holder=holder)

    def _not_held(self, held: AuthorityMessage, wrong: str) -> RequestError:
        who = held.holder
        if who is None:
            text = f"{wrong}: nobody holds it; request it first"
        else:
            left_s = max(held.utc + held.lease_left - self._utc(), 0.0)
            operator = "" if held.operator in {None, who} else f" ({held.operator})"
            text = (
                f"{wrong}: {who}{operator} holds it for another {left_s:.0f} s; request it, so that"
                " its holder hears of it"
            )
        return refused(HTTPStatus.FORBIDDEN, text, holder=held.operator or who)


def _key(link: RoverLink) -> Key:
    return link.asset, link.kind


def _is_news(before: AuthorityMessage, now: AuthorityMessage) -> bool:
    ends_s = (before.utc + before.lease_left, now.utc + now.lease_left)
    renewed = now.holder is not None and abs(ends_s[1] - ends_s[0]) > RENEWAL_S
    return renewed or replace(now, utc=before.utc, lease_left=before.lease_left) != before
