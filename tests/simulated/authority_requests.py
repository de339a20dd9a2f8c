"""What two operators do about the authority, as data, and how it is done."""

from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import Final, assert_never

from adapters.mrs.ground.session import SessionAuthority
from adapters.mrs.spec import AuthorityStatus
from executive.settings import AuthoritySettings

RIVAL: Final = "rival"
"""The process of the second operator, on the direct link."""
RIVAL_SOURCE: Final = "OPS"
LEASE_S: Final = 10.0
LENT_S: Final = 60.0
OPERATORS: Final = ("direct", RIVAL)
ORBITER: Final = AuthoritySettings().relay
"""Who holds the authority for the commands of the relay."""


class Act(Enum):
    """What an operator does about the authority."""

    REQUEST = "request"
    TAKE = "take"
    HAND_OVER = "hand over"
    RELEASE = "release"
    LEND = "hand over to the orbiter"


@dataclass(frozen=True, slots=True)
class RequestAuthority:
    """An operator asks for the authority, or gives it away."""

    at_s: float
    operator: str
    act: Act


def draw_requests(
    chance: Random, begin_s: float, end_s: float, pause_s: float
) -> list[RequestAuthority]:
    """Draw what operators do about the authority."""
    requests: list[RequestAuthority] = []
    at_s = begin_s
    while at_s < end_s:
        at_s += chance.expovariate(1 / pause_s)
        act = chance.choice((*[Act.REQUEST] * 3, *Act, Act.LEND))
        requests.append(RequestAuthority(at_s, chance.choice(OPERATORS), act))
    return requests


async def do(act: Act, other: str, authority: SessionAuthority) -> AuthorityStatus:
    """Do it over a session; raises as `SessionAuthority` does.

    Args:
        act: what.
        other: the source of the other operator.
        authority: of the session.
    """
    match act:
        case Act.REQUEST:
            return await authority.request()
        case Act.TAKE:
            return await authority.take()
        case Act.HAND_OVER:
            return await authority.hand_over(other)
        case Act.RELEASE:
            return await authority.release()
        case Act.LEND:
            return await authority.hand_over(ORBITER, LENT_S)
        case _:
            assert_never(act)
