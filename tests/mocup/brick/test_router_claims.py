"""One command by both links, of which one ends at the executive and the other at the brick."""

from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import RESTARTED
from adapters.mops import Message, encode
from tests.mocup.brick.routing import (
    Bench,
    claimed,
    executed,
    forward,
    part,
    received,
    report,
    stop,
)


def test_the_executive_receives_the_result_of_a_command_by_the_relay(bench: Bench) -> None:
    command = replace(forward(7), moe_inputs_counter=3)
    bench.command(BrickLink.RELAY, command)
    bench.sends(received(command))
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1), part(7, 1))
    assert bench.ports.brick == [encode(command)]
    bench.ports.notified.clear()
    bench.sends(executed(command))
    assert bench.ports.notified == [
        (BrickLink.RELAY, executed(command)),
        (BrickLink.DIRECT, executed(forward(7))),
    ]
    bench.command(BrickLink.DIRECT, part(7, 2))
    assert bench.ports.notified[2:] == [(BrickLink.DIRECT, executed(forward(7)))]
    assert bench.ports.brick == [encode(command)]


def test_another_command_under_a_claimed_number_is_refused(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, claimed(forward(7)))
    bench.command(BrickLink.RELAY, forward(7, distance="9.0"))
    ((link, reported),) = bench.ports.notified
    assert (link, reported.outputs[:2]) == (BrickLink.RELAY, ("REJECTED", "DUPLICATE"))
    assert bench.ports.brick == []


def test_a_claimed_stop_is_passed_on_for_the_relay_all_the_same(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, claimed(stop(7)))
    bench.command(BrickLink.RELAY, stop(7))
    assert bench.ports.brick == [encode(stop(7))]


def test_a_stop_by_the_relay_ends_all_claims_of_the_executive_until_then(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, claimed(forward(7)), report(forward(7), "STARTED"))
    bench.command(BrickLink.RELAY, stop(40))
    ((reported, message),) = bench.ports.notified
    assert (reported, message.command, message.moe_inputs_id) == (
        BrickLink.DIRECT,
        stop(40).command,
        40,
    )
    bench.command(BrickLink.DIRECT, part(7, 1))
    assert bench.ports.brick == [encode(stop(40))]
    late = bench.ports.notified[-1]
    assert late[0] is BrickLink.DIRECT
    assert late[1].outputs[:1] == ("CANCELLED",)
    bench.command(
        BrickLink.DIRECT, report(forward(7), "CANCELLED"), claimed(forward(8)), part(8, 2)
    )
    assert bench.ports.brick == [encode(stop(40)), encode(part(8, 2))]


def test_a_stop_that_the_brick_does_not_get_is_not_reported_to_the_executive(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1))
    bench.ports.there = False
    bench.command(BrickLink.RELAY, stop(40))
    ((link, reported),) = bench.ports.notified
    assert (link, reported.outputs[:1]) == (BrickLink.RELAY, ("REJECTED",))


def test_a_stop_under_the_number_of_another_command_stops_and_is_refused(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, forward(7), stop(7))
    assert bench.ports.brick == [encode(forward(7)), encode(stop(7))]
    (reported,) = [message for link, message in bench.ports.notified if link is BrickLink.RELAY]
    assert reported.outputs[:2] == ("REJECTED", "DUPLICATE")
    bench.sends(executed(stop(7)))
    bench.command(BrickLink.RELAY, forward(7))
    assert forward(7) not in [m for _, m in bench.ports.notified if m.executed]


def test_what_cannot_be_recorded_is_refused_but_a_stop_stops(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, forward(1))
    bench.sends(executed(forward(1)))
    bench.ports.notified.clear()
    bench.fill_disk(True)
    bench.command(BrickLink.DIRECT, forward(2), stop(3))
    assert bench.ports.brick == [encode(forward(1)), encode(stop(3))]
    ((_, rejected),) = bench.ports.notified
    assert (rejected.moe_inputs_id, rejected.outputs[:2]) == (2, ("REJECTED", "LEDGER_FAILED"))
    bench.fill_disk(False)
    bench.command(BrickLink.DIRECT, forward(2))
    assert bench.ports.brick[2:] == [encode(forward(2))]


def test_an_unrecorded_command_of_the_relay_is_repeated_and_has_one_end(
    bench: Bench,
) -> None:
    bench.fill_disk(True)
    assert not bench.router.process(BrickLink.RELAY, str(forward(2)))
    assert not bench.router.process(BrickLink.RELAY, str(stop(3)))
    bench.sends(executed(stop(3)))
    assert bench.ports.brick == [encode(stop(3))]
    bench.fill_disk(False)
    assert reported(bench, BrickLink.RELAY) == []
    assert bench.router.process(BrickLink.RELAY, str(stop(3)))
    bench.sends(executed(stop(3)))
    assert bench.router.process(BrickLink.RELAY, str(forward(2)))
    bench.sends(executed(forward(2)))
    replies = [message for link, message in bench.ports.notified if link is BrickLink.RELAY]
    assert replies == [executed(stop(3)), executed(forward(2))]


def refused(command: Message) -> Message:
    return replace(received(command), received=False, outputs=("REJECTED", "QUEUE_FULL", "BUSY"))


def reported(bench: Bench, link: BrickLink) -> list[str]:
    return [message.outputs[0] for to, message in bench.ports.notified if to is link]


def test_a_command_refused_by_the_brick_for_the_relay_may_be_executed_for_the_executive(
    bench: Bench,
) -> None:
    bench.command(BrickLink.RELAY, forward(7))
    bench.sends(refused(forward(7)))
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1))
    assert bench.ports.brick == [encode(forward(7)), encode(part(7, 1))]
    bench.command(BrickLink.DIRECT, report(forward(7), "EXECUTED"))
    assert reported(bench, BrickLink.DIRECT) == []
    bench.command(BrickLink.DIRECT, part(7, 1))
    bench.command(BrickLink.RELAY, forward(7))
    assert len(bench.ports.brick) == 2
    assert reported(bench, BrickLink.RELAY) == ["REJECTED", "REJECTED"]


def test_the_executive_is_not_notified_of_another_command_under_its_number(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, forward(7, distance="9.0"))
    bench.sends(executed(forward(7)))
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1))
    assert reported(bench, BrickLink.DIRECT) == ["REJECTED", "REJECTED"]
    assert len(bench.ports.brick) == 1


def test_a_command_of_a_source_named_like_the_brick_is_a_command(bench: Bench) -> None:
    command = forward(7, source="MOCUP")
    bench.command(BrickLink.DIRECT, claimed(command), replace(command, moe_inputs_counter=1))
    assert len(bench.ports.brick) == 1
    bench.command(BrickLink.RELAY, command)
    assert len(bench.ports.brick) == 1


@pytest.mark.parametrize(
    "message", [claimed(forward(7)), executed(forward(7)), report(forward(7), "EXECUTED")]
)
def test_an_invalid_command_does_not_reach_the_brick_by_the_relay(
    bench: Bench, message: Message
) -> None:
    bench.command(BrickLink.RELAY, replace(message, source="MOE", dest="MOCUP"))
    assert bench.ports.brick == []
    assert len(bench.reported) == 1


def test_a_returning_client_receives_the_last_replies(tmp_path: Path) -> None:
    bench = Bench()
    record = BrickRecord(tmp_path / "nxt.sqlite")
    bench.start(record)
    bench.command(BrickLink.RELAY, forward(1))
    bench.sends(executed(forward(1)))
    bench.command(BrickLink.RELAY, forward(2))
    bench.command(BrickLink.DIRECT, claimed(forward(2)), claimed(forward(3)), part(3, 1))
    bench.command(BrickLink.RELAY, forward(3))
    bench.command(BrickLink.DIRECT, report(forward(3), "STARTED"))
    record.close()
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    bench.router.on_disconnected(RESTARTED)
    for link, numbers in ((BrickLink.RELAY, [1, 2, 3]), (BrickLink.DIRECT, [2, 3])):
        bench.ports.notified.clear()
        bench.router.resend_last(link)
        assert [m.moe_inputs_id for to, m in bench.ports.notified if to is link] == numbers
