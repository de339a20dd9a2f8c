"""What happens in a storm, and after how many messages."""

from dataclasses import dataclass
from enum import Enum, unique
from random import Random
from typing import Final


@dataclass(frozen=True, slots=True)
class Plan:
    """What a storm is to be.

    Attributes:
        messages: commands to be acknowledged, each of which has one report.
        kills: of the two sides in turn, in random order.
        loss: part of the datagrams that is lost.
        seed: of when what happens.
    """

    messages: int
    kills: int
    loss: float
    seed: int


@unique
class Mishap(Enum):
    """What happens."""

    KILL_ORBITER = "orbiter killed"
    KILL_RELAY = "rover-relay killed"
    STEP_ORBITER = "orbiter's clock stepped back"
    STEP_RELAY = "rover-relay's clock stepped back"
    FILL_ORBITER = "orbiter's disk full"
    FILL_RELAY = "rover-relay's disk full"
    DIE_ORBITER = "orbiter killed while its disk is full"
    DIE_RELAY = "rover-relay killed while its disk is full"


KILLS: Final = (Mishap.KILL_RELAY, Mishap.KILL_ORBITER)
STEPS: Final = (Mishap.STEP_ORBITER, Mishap.STEP_RELAY)
FILLS: Final = (Mishap.FILL_RELAY, Mishap.FILL_ORBITER)
DEATHS: Final = (Mishap.DIE_ORBITER, Mishap.DIE_RELAY)
EARLY: Final = (60, 150)
"""Messages after which disks are first full: while stores still grow, so that writes fail."""


def mishaps(plan: Plan, random: Random, undisturbed: bool) -> list[tuple[int, Mishap]]:
    """Return what is to happen after how many messages, in turn.

    Args:
        plan: how much.
        random: of the kills.
        undisturbed: whether no disk can be filled.
    """
    kills = [KILLS[number % len(KILLS)] for number in range(plan.kills)]
    random.shuffle(kills)
    found = [(random.randrange(plan.messages), kill) for kill in kills]
    third = plan.messages // 3
    found += zip((third, 2 * third), STEPS, strict=True)
    if not undisturbed:
        found += zip((min(each, third) for each in EARLY), FILLS, strict=True)
        found += zip((third, 2 * third), DEATHS, strict=True)
    return sorted(found, key=lambda each: each[0])
