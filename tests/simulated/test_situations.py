"""Situations that storms found, or find rarely, each as short as it can be."""

from dataclasses import replace

import pytest

from executive.commands import MoveForward, Resume, Stop
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
from tests.simulated.storm import play

CALM = Situation(
    delay_s=0.02,
    jitter_s=0.0,
    loss=0.0,
    duplicate=0.0,
    eclipse_s=0.0,
    contact_s=0.0,
    ask_again_s=None,
    period_s=60.0,
)


def storm(*deeds: Deed) -> Storm:
    return Storm("situation", CALM, deeds)


def test_commands_outlast_a_disk_that_is_full_for_minutes() -> None:
    played = play(
        storm(
            FillDisk(15.0, "executive", 90.0),
            Order(20.0, Link.RELAY, 1, Stop()),
            Order(22.0, Link.RELAY, 2, Resume()),
            Order(23.0, Link.RELAY, 3, MoveForward(0.2)),
            Order(150.0, Link.RELAY, 4, Resume()),
        )
    )
    assert not played.findings


@pytest.mark.parametrize("writes", [3, 4])
def test_a_stop_that_a_full_disk_does_not_record_has_one_end(writes: int) -> None:
    played = play(
        storm(
            FillDisk(15.0, "executive", 40.0),
            Order(16.0, Link.DIRECT, 1, Resume()),
            KillAtWrite(20.0, "relay", writes, after=True, down_s=45.0),
            Order(20.0, Link.RELAY, 2, Stop()),
        )
    )
    assert not played.findings


def test_a_client_that_only_listens_notices_that_the_orbiter_has_forgotten_its_connection() -> None:
    far = replace(CALM, delay_s=3.0)  # the reports come when the connection is half open
    deeds = (
        Order(20.0, Link.RELAY, 1, MoveForward(0.2)),
        CutWay(20.5, "moe", "orbiter", 10.0),
        Kill(21.0, "orbiter", 1.0),
    )
    played = play(Storm("situation", far, deeds))
    assert not played.findings
