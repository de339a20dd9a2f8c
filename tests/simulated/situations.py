"""Situations that storms found, or find rarely, each as short as it can be."""

from typing import Final

from executive.commands import MoveForward, Resume, SetTravelSpeed, Stop
from tests.simulated.deeds import (
    CutWay,
    Deed,
    FillDisk,
    Kill,
    KillAtWrite,
    Link,
    Order,
    Situation,
    Storm,
)

CALM: Final = Situation(
    delay_s=0.02,
    jitter_s=0.0,
    loss=0.0,
    duplicate=0.0,
    eclipse_s=0.0,
    contact_s=0.0,
    ask_again_s=None,
    period_s=60.0,
)


def _storm(*deeds: Deed) -> Storm:
    return Storm("situation", CALM, deeds)


FULL_FOR_MINUTES: Final = _storm(
    FillDisk(15.0, "executive", 90.0),
    Order(20.0, Link.RELAY, 1, Stop()),
    Order(22.0, Link.RELAY, 2, Resume()),
    Order(23.0, Link.RELAY, 3, MoveForward(0.2)),
    Order(150.0, Link.RELAY, 4, Resume()),
)
"""Commands wait at rover-relay for longer than it takes to publish them 30 times."""
LATE_REPORT: Final = _storm()
REFUSED_UNHEARD: Final = _storm(
    FillDisk(15.0, "executive", 10.0),
    Order(20.0, Link.RELAY, 1, MoveForward(0.2)),
    KillAtWrite(20.1, "orbiter", 1, True, 5.0),
)
REPEAT_ANSWERED: Final = _storm(
    Order(20.0, Link.DIRECT, 1, SetTravelSpeed(0.2)),
    Order(25.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    KillAtWrite(25.0, "relay", 1, True, 2.0),
)
FIRST_REPORT: Final = _storm(
    Kill(19.0, "executive", 10.0),
    Order(20.0, Link.RELAY, 1, SetTravelSpeed(0.2)),
    Kill(22.0, "orbiter", 15.0),
    CutWay(22.0, "moe", "orbiter", 30.0),
)
