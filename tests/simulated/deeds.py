"""What happens in a storm, as data: commands, kills and faults, drawn from a seed."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum
from random import Random
from typing import Final

from executive.commands import (
    MoveForward,
    Request,
    Resume,
    RotateBy,
    SetCameraAngles,
    SetTravelSpeed,
    Stop,
)
from tests.simulated.authority_requests import RIVAL, RequestAuthority, draw_requests
from tests.simulated.convergence import Convergence

RELAY_PROCESSES: Final = ("orbiter", "relay", "executive")
MOCUP_PROCESSES: Final = ("orbiter", "relay", "nxt", "executive")
_FIRST_NUMBER: Final = 1
_SECOND_NUMBER: Final = 10_000
"""Added to the numbers of commands for the second rover."""
_SETTLE_S: Final = 10.0
_DOWN_S: Final = (0.2, 6.0)
_ORDER_S: Final = 5.5
"""Between two moments at which commands are sent, in the mean."""
_TROUBLE_S: Final = 6.0
_CONSOLE_TROUBLE_S: Final = 4.0
_UNPLUG_S: Final = 50.0
_RESUME_S: Final = 20
_LONG_S: Final = 600.0
"""Storms that last so long have one rover, since two take twice the time."""

_REQUEST_S: Final = 9.0
"""Between two deeds of operators about the authority, in the mean."""


class Link(Enum):
    """By which way a command goes: the name of the ground's process."""

    DIRECT = "direct"
    RELAY = "moe"
    RIVAL = RIVAL
    CONSOLE = "browser"
    DIRECT_2 = "direct2"
    RELAY_2 = "moe2"


@dataclass(frozen=True, slots=True)
class Order:
    """A command is sent, perhaps again."""

    at_s: float
    link: Link
    number: int
    request: Request


@dataclass(frozen=True, slots=True)
class Kill:
    """A process is killed between two events, and is started again."""

    at_s: float
    process: str
    down_s: float
    power: bool = False


@dataclass(frozen=True, slots=True)
class KillAtWrite:
    """A process is killed before or right after one of its next writes to the disk."""

    at_s: float
    process: str
    writes: int
    after: bool
    down_s: float


@dataclass(frozen=True, slots=True)
class Terminate:
    """A process receives SIGTERM, and is started again."""

    at_s: float
    process: str


@dataclass(frozen=True, slots=True)
class FailWrite:
    """One of the next writes of a process fails."""

    at_s: float
    process: str
    writes: int


@dataclass(frozen=True, slots=True)
class FillDisk:
    """The disk of a process is full for a while."""

    at_s: float
    process: str
    for_s: float


@dataclass(frozen=True, slots=True)
class Pause:
    """A process is stopped (SIGSTOP) for a while."""

    at_s: float
    process: str
    for_s: float


@dataclass(frozen=True, slots=True)
class StepClock:
    """The clock of a computer is set."""

    at_s: float
    process: str
    step_s: float


@dataclass(frozen=True, slots=True)
class CutChannel:
    """Nothing gets through between two computers for a while; connections stay half open."""

    at_s: float
    process: str
    peer: str
    for_s: float


@dataclass(frozen=True, slots=True)
class LoseSamples:
    """A part of what is published on ROS topics is lost for a while."""

    at_s: float
    part: float
    for_s: float


@dataclass(frozen=True, slots=True)
class Unplug:
    """The brick's cable is taken off for a while."""

    at_s: float
    for_s: float


Deed = (
    Order
    | Kill
    | KillAtWrite
    | Terminate
    | FailWrite
    | FillDisk
    | Pause
    | StepClock
    | CutChannel
    | LoseSamples
    | Unplug
    | RequestAuthority
)


@dataclass(frozen=True, slots=True)
class Situation:
    """What stays as it is during a storm.

    Attributes:
        delay_s: the time of light between orbiter and rover.
        jitter_s, loss, duplicate: of datagrams there.
        eclipse_s, contact_s: how long there is no contact, and how long there is; 0 for always.
        retransmit_after_s: see `OrbiterSettings`.
        period_s: how long commands are sent and processes killed.
        authority_needed: whether commands need the authority, which two operators ask for; None
            for where nobody does.
        convergence: by which layer bundles go between orbiter and rover.
        rovers: how many are behind the orbiter.
        mocup: whether the rover is MOCUP, whose brick `rover-nxt` serves.
        console: whether an operator has a page of `rover-console` open.
    """

    delay_s: float
    jitter_s: float
    loss: float
    duplicate: float
    eclipse_s: float
    contact_s: float
    retransmit_after_s: float | None
    period_s: float
    authority_needed: bool | None = None
    convergence: Convergence = Convergence.LTP
    rovers: int = 1
    mocup: bool = False
    console: bool = False


@dataclass(frozen=True, slots=True)
class Storm:
    """A whole storm: it is the same whenever it is played.

    Attributes:
        seed: of what the world draws meanwhile.
    """

    seed: str
    situation: Situation
    deeds: tuple[Deed, ...]


def draw_storm(seed: int | str) -> Storm:
    """Draw a storm: some minutes with a command each few seconds and a kill about as often."""
    chance = Random(f"storm {seed}")
    situation = _situation(chance)
    deeds: list[Deed] = [*_orders(chance, situation), *_troubles(chance, situation)]
    if situation.authority_needed is not None:
        deeds += _operators(Random(f"operators {seed}"), situation)
    if situation.rovers > 1:
        deeds += _second_rover(Random(f"second rover {seed}"), situation)
    return Storm(str(seed), situation, tuple(sorted(deeds, key=lambda deed: deed.at_s)))


def draw_mocup_storm(seed: int | str) -> Storm:
    """Draw a storm over MOCUP: commands by both links, many by each; its brick is unplugged."""
    chance = Random(f"mocup storm {seed}")
    drawn = _situation(chance)
    situation = replace(drawn, period_s=300.0, retransmit_after_s=60.0, rovers=1, mocup=True)
    deeds: list[Deed] = [*_mocup_orders(chance, situation)]
    if situation.authority_needed is not None:
        deeds += _operators(Random(f"operators {seed}"), situation)
    deeds += _troubles(chance, situation, MOCUP_PROCESSES)
    at_s = _SETTLE_S
    while (at_s := at_s + chance.expovariate(1 / _UNPLUG_S)) < situation.period_s:
        deeds.append(Unplug(at_s, chance.uniform(0.1, 8.0)))
    return Storm(str(seed), situation, tuple(sorted(deeds, key=lambda deed: deed.at_s)))


def _mocup_orders(chance: Random, situation: Situation) -> Iterator[Order]:
    """Draw commands that MOCUP's brick knows; the direct link resumes now and then."""
    for order in _orders(chance, situation):
        match order.request:
            case Resume() if order.link is Link.RELAY:
                yield replace(order, link=Link.DIRECT)
                continue
            case SetTravelSpeed(speed_mps):
                order = replace(order, request=SetTravelSpeed(speed_mps / 2))
            case _:
                pass
        yield order
        if chance.random() < 0.25:
            other = Link.DIRECT if order.link is Link.RELAY else Link.RELAY
            yield replace(order, at_s=order.at_s + chance.uniform(0.0, 3.0), link=other)
    for at_s in range(round(_SETTLE_S), round(situation.period_s), _RESUME_S):
        yield Order(at_s + chance.random(), Link.DIRECT, _SECOND_NUMBER + at_s, Resume())


def draw_console_storm(seed: int | str) -> Storm:
    """Draw a storm over a console: most commands are posted there, some by another operator."""
    chance = Random(f"console storm {seed}")
    drawn = _situation(chance)
    situation = replace(
        drawn,
        period_s=200.0,
        retransmit_after_s=60.0,
        authority_needed=None,
        rovers=1,
        console=True,
    )
    deeds: list[Deed] = []
    for order in _orders(chance, situation):
        posted = chance.random() < 0.7
        deeds.append(replace(order, link=Link.CONSOLE) if posted else order)
        if posted and chance.random() < 0.15:  # about when it is written down and answered
            after, down_s = chance.random() < 0.5, chance.uniform(*_DOWN_S)
            deeds.append(KillAtWrite(order.at_s, "console", chance.randint(1, 3), after, down_s))
    deeds += _troubles(chance, situation)[::2]
    at_s = _SETTLE_S
    while (at_s := at_s + chance.expovariate(1 / _CONSOLE_TROUBLE_S)) < situation.period_s:
        deeds.append(_console_trouble(chance, at_s))
    return Storm(str(seed), situation, tuple(sorted(deeds, key=lambda deed: deed.at_s)))


def _console_trouble(chance: Random, at_s: float) -> Deed:
    down_s, cut_s = chance.uniform(*_DOWN_S), chance.uniform(0.2, 20.0)
    match chance.randrange(18):
        case 0 | 1 | 2:
            return Kill(at_s, "console", down_s)
        case 3 | 4:
            return KillAtWrite(at_s, "console", chance.randint(1, 6), chance.random() < 0.5, down_s)
        case 5 | 6 | 7 | 8:
            return FailWrite(at_s, "console", chance.randint(1, 4))
        case 9:
            return FillDisk(at_s, "console", cut_s)
        case 10:
            return Kill(at_s, "console", down_s, power=True)
        case 11:
            return Pause(at_s, "console", chance.uniform(0.5, 20.0))
        case 12:
            return CutChannel(at_s, "console", chance.choice(("executive", "orbiter")), cut_s)
        case 13:
            return CutChannel(at_s, "browser", "console", cut_s)
        case 14:
            return Kill(at_s, "browser", down_s)
        case 15 | 16:
            return Terminate(at_s, "console")
        case _:
            return CutChannel(at_s, "console", "executive", chance.uniform(0.2, 2.0))


def _second_rover(chance: Random, situation: Situation) -> Iterator[Deed]:
    """Draw what happens to a second rover: commands by numbers of their own, and troubles."""
    links = {Link.DIRECT: Link.DIRECT_2, Link.RELAY: Link.RELAY_2}
    for order in _orders(chance, situation):
        number = order.number + _SECOND_NUMBER
        yield replace(order, link=links[order.link], number=number)
    for deed in _troubles(chance, situation):
        match deed:
            case CutChannel(process=process, peer=peer):
                other = peer if peer == "orbiter" else f"{peer}2"
                yield replace(deed, process=f"{process}2", peer=other)
            case LoseSamples() | Order() | RequestAuthority() | Unplug():
                pass
            case _ if deed.process != "orbiter":
                yield replace(deed, process=f"{deed.process}2")
            case _:
                pass


def _situation(chance: Random) -> Situation:
    far = chance.random() < 0.3
    eclipsed = chance.random() < 0.3
    situation = Situation(
        delay_s=chance.uniform(0.5, 2.0) if far else chance.uniform(0.005, 0.05),
        jitter_s=chance.choice((0.0, 0.02, 0.3)),
        loss=chance.choice((0.0, 0.02, 0.1)),
        duplicate=chance.choice((0.0, 0.0, 0.05)),
        eclipse_s=chance.uniform(30.0, 120.0) if eclipsed else 0.0,
        contact_s=chance.uniform(60.0, 180.0) if eclipsed else 0.0,
        retransmit_after_s=chance.choice((None, 120.0)),
        period_s=chance.choice((440.0, 440.0, 1320.0)),
        authority_needed=chance.choice((None, None, False, True)),
        convergence=chance.choice((Convergence.LTP, *Convergence)),
        rovers=chance.choice((1, 1, 1, 2)),
    )
    short = situation.period_s < _LONG_S
    return situation if short else replace(situation, rovers=1)


def _request(chance: Random) -> Request:
    match chance.randrange(10):
        case 0:
            return Stop()
        case 1 | 2:
            return Resume()
        case 3:
            return SetTravelSpeed(round(chance.uniform(0.1, 0.4), 2))
        case 4:
            return SetCameraAngles(round(chance.uniform(-1.0, 1.0), 2), 0.0)
        case 5:
            return RotateBy(round(chance.uniform(-1.0, 1.0), 2))
        case _:
            return MoveForward(round(chance.uniform(0.1, 0.6), 2))


def _orders(chance: Random, situation: Situation) -> list[Order]:
    orders: list[Order] = []
    at_s, number = _SETTLE_S, _FIRST_NUMBER
    while at_s < situation.period_s:
        at_s += chance.expovariate(1 / _ORDER_S)
        if orders and chance.random() < 0.25:  # one of the last ones again, by whichever link
            again = chance.choice(orders[-20:])
            link = chance.choice((Link.DIRECT, Link.RELAY))
            orders.append(Order(at_s, link, again.number, again.request))
            continue
        link = Link.RELAY if chance.random() < 0.7 else Link.DIRECT
        for _ in range(chance.choice((1, 1, 1, 2, 4))):  # some come in one string
            request = _request(chance)
            orders.append(Order(at_s, link, number, request))
            number += 1
            if isinstance(request, Stop) and link is Link.RELAY and chance.random() < 0.5:
                # What the stop overtakes then comes to a rover that has been resumed.
                resumed_s = at_s + chance.uniform(0.5, 10.0)
                orders.append(Order(resumed_s, Link.DIRECT, number, Resume()))
                number += 1
    return orders


def _operators(chance: Random, situation: Situation) -> list[Deed]:
    """Draw what two operators do about the authority, and what the second one commands."""
    deeds: list[Deed] = [*draw_requests(chance, _SETTLE_S, situation.period_s, _REQUEST_S)]
    at_s, number = _SETTLE_S, _FIRST_NUMBER
    while at_s < situation.period_s:
        at_s += chance.expovariate(1 / _REQUEST_S)
        match chance.randrange(8):
            case 0:
                deeds.append(Kill(at_s, RIVAL, chance.uniform(*_DOWN_S)))
            case 1:
                deeds.append(CutChannel(at_s, RIVAL, "executive", chance.uniform(1.0, 60.0)))
            case _:
                deeds.append(Order(at_s, Link.RIVAL, number, _request(chance)))
                number += 1
    return deeds


def _troubles(
    chance: Random, situation: Situation, processes: tuple[str, ...] = RELAY_PROCESSES
) -> list[Deed]:
    deeds: list[Deed] = []
    at_s = _SETTLE_S
    while at_s < situation.period_s:
        at_s += chance.expovariate(1 / _TROUBLE_S)
        deeds.append(_trouble(chance, at_s, processes))
    return deeds


def _trouble(chance: Random, at_s: float, processes: tuple[str, ...]) -> Deed:
    process = chance.choice((*processes, *processes, "moe", "moe", "direct"))
    down_s = chance.uniform(*_DOWN_S)
    if process not in processes:
        if chance.random() < 0.25:
            return Kill(at_s, process, down_s)
        peer = "orbiter" if process == "moe" else "executive"
        return CutChannel(at_s, process, peer, chance.uniform(1.0, 60.0))
    match chance.randrange(20):
        case 0 | 1 | 2 | 3 | 4 | 5:
            return Kill(at_s, process, down_s)
        case 6 | 7 | 8 | 9 | 10:
            return KillAtWrite(at_s, process, chance.randint(1, 12), chance.random() < 0.5, down_s)
        case 11 | 12 | 13 | 14:
            return FailWrite(at_s, process, chance.randint(1, 12))
        case 15:
            return FillDisk(at_s, process, chance.uniform(1.0, 60.0))
        case 16:
            return Pause(at_s, process, chance.uniform(0.5, 20.0))
        case 17:
            return StepClock(at_s, process, chance.uniform(-900.0, 900.0))
        case 18:
            return LoseSamples(at_s, chance.uniform(0.05, 0.5), chance.uniform(1.0, 30.0))
        case _:
            return Kill(at_s, process, down_s, power=True)
