"""What was lost, refused by the brick or numbered alike makes no second command of one."""

from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mocup.brick.record import BrickRecord, Link
from adapters.mocup.brick.router import RESTARTED
from adapters.mops import Message, encode
from tests.mocup.brick.routing import (
    Bench,
    executed,
    forward,
    received,
    stop,
)
from tests.mocup.brick.test_router_claims import claimed, part, report


@pytest.fixture
def bench() -> Bench:
    return Bench()


def refused(command: Message) -> Message:
    return replace(received(command), received=False, outputs=("REJECTED", "QUEUE_FULL", "BUSY"))


def told(bench: Bench, link: Link) -> list[str]:
    return [message.outputs[0] for to, message in bench.exits.notified if to is link]


def test_what_the_brick_refused_the_relay_the_executive_may_carry_out(bench: Bench) -> None:
    bench.command(Link.RELAY, forward(7))
    bench.says(refused(forward(7)))
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    assert bench.exits.brick == [encode(forward(7)), encode(part(7, 1))]
    bench.command(Link.DIRECT, report(forward(7), "EXECUTED"))
    assert told(bench, Link.RELAY) == ["REJECTED", "EXECUTED"]
    assert told(bench, Link.DIRECT) == []
    bench.command(Link.RELAY, forward(7))
    assert len(bench.exits.brick) == 2
    assert told(bench, Link.RELAY)[2:] == ["EXECUTED"]


def test_what_the_brick_refuses_after_the_claim_is_left_to_the_part_that_comes_again(
    bench: Bench,
) -> None:
    bench.command(Link.RELAY, forward(7))
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    bench.says(refused(forward(7)))
    bench.command(Link.DIRECT, part(7, 1))
    assert bench.exits.brick == [encode(forward(7)), encode(part(7, 1))]
    assert told(bench, Link.DIRECT) == []


def test_a_part_with_the_counter_of_the_relays_copy_is_a_part_all_the_same(bench: Bench) -> None:
    copy = replace(forward(7), moe_inputs_counter=1)
    bench.command(Link.RELAY, copy)
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    bench.says(executed(copy))
    assert bench.exits.brick == [encode(copy)]
    assert told(bench, Link.DIRECT) == ["EXECUTED"]


def test_where_the_claim_was_lost_a_part_claims_and_the_relay_hears_the_reports(
    bench: Bench,
) -> None:
    bench.command(Link.DIRECT, part(7, 1))
    bench.command(Link.RELAY, forward(7))
    assert bench.exits.brick == [encode(part(7, 1))]
    assert told(bench, Link.RELAY) == []
    bench.command(Link.DIRECT, report(forward(7), "EXECUTED"))
    assert told(bench, Link.RELAY) == ["EXECUTED"]


def test_a_late_claim_of_something_else_under_the_number_refuses_the_relays(bench: Bench) -> None:
    bench.command(Link.DIRECT, part(7, 1))
    bench.command(Link.RELAY, forward(7, distance="9.0"))
    bench.command(Link.DIRECT, claimed(forward(7)), report(forward(7), "EXECUTED"))
    assert told(bench, Link.RELAY) == ["REJECTED"]


def test_the_executive_is_not_told_of_another_command_under_its_number(bench: Bench) -> None:
    bench.command(Link.RELAY, forward(7, distance="9.0"))
    bench.says(executed(forward(7)))
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    assert told(bench, Link.DIRECT) == ["REJECTED", "REJECTED"]
    assert len(bench.exits.brick) == 1


def test_a_stop_under_a_claimed_number_stops_that_as_any_other(bench: Bench) -> None:
    bench.command(Link.DIRECT, claimed(forward(7)))
    bench.command(Link.RELAY, stop(7))
    bench.says(executed(stop(7)))
    bench.exits.notified.clear()
    bench.command(Link.DIRECT, part(7, 1))
    assert bench.exits.brick == [encode(stop(7))]
    assert told(bench, Link.DIRECT) == ["CANCELLED"]


def test_a_command_of_a_source_named_like_the_brick_is_a_command(bench: Bench) -> None:
    command = forward(7, source="MOCUP")
    bench.command(Link.DIRECT, claimed(command), replace(command, moe_inputs_counter=1))
    assert len(bench.exits.brick) == 1
    bench.command(Link.RELAY, command)
    assert len(bench.exits.brick) == 1


@pytest.mark.parametrize(
    "message", [claimed(forward(7)), executed(forward(7)), report(forward(7), "EXECUTED")]
)
def test_what_is_no_command_does_not_reach_the_brick_by_the_relay(
    bench: Bench, message: Message
) -> None:
    bench.command(Link.RELAY, replace(message, source="MOE", dest="MOCUP"))
    assert bench.exits.brick == []
    assert len(bench.told) == 1


def test_who_comes_back_is_told_the_last_words(tmp_path: Path) -> None:
    bench = Bench()
    record = BrickRecord(tmp_path / "nxt.sqlite")
    bench.start(record)
    bench.command(Link.RELAY, forward(1))
    bench.says(executed(forward(1)))
    bench.command(Link.RELAY, forward(2))
    bench.command(Link.DIRECT, claimed(forward(2)), claimed(forward(3)), part(3, 1))
    bench.command(Link.RELAY, forward(3))
    bench.command(Link.DIRECT, report(forward(3), "STARTED"))
    record.close()
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    bench.router.lost(RESTARTED)
    for link, numbers in ((Link.RELAY, [1, 2, 3]), (Link.DIRECT, [2, 3])):
        bench.exits.notified.clear()
        bench.router.again(link)
        assert [m.moe_inputs_id for to, m in bench.exits.notified if to is link] == numbers


def test_what_the_executive_tells_again_the_relay_hears_once(bench: Bench) -> None:
    bench.command(Link.DIRECT, claimed(forward(7)))
    bench.command(Link.RELAY, forward(7))
    for stage in ("STARTED", "EXECUTED", "EXECUTED", "STARTED"):
        bench.command(Link.DIRECT, claimed(forward(7)), report(forward(7), stage))
    assert told(bench, Link.RELAY) == ["STARTED", "EXECUTED"]
