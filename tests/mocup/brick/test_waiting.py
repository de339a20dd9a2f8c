"""What comes by the relay while the brick is at work waits, and ends in one way or another."""

from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mocup.brick.ownership import MAX_QUEUED
from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import RESTARTED
from adapters.mops import decode
from tests.mocup.brick.routing import Bench, claimed, executed, forward, part, stop


def sent(bench: Bench) -> list[int]:
    requested = map(decode, bench.ports.brick)
    return [message.moe_inputs_id or 0 for message in requested if message.source == "MOE"]


def reported(bench: Bench) -> list[tuple[BrickLink, int | None, str]]:
    """Return what was told since the last call."""
    received = [(link, m.moe_inputs_id, m.outputs[0]) for link, m in bench.ports.notified]
    bench.ports.notified.clear()
    return received


def by_relay(bench: Bench) -> list[tuple[int | None, str]]:
    return [(number, stage) for link, number, stage in reported(bench) if link is BrickLink.RELAY]


def at_work(bench: Bench, count: int = 3) -> None:
    """Have the brick at the first of some commands of the relay."""
    bench.command(BrickLink.RELAY, *(forward(number) for number in range(1, count + 1)))
    reported(bench)


def test_it_does_not_wait_for_an_executive_that_has_ended(bench: Bench) -> None:
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1))
    bench.command(BrickLink.RELAY, forward(8))
    bench.sends(executed(part(7, 1)))
    bench.router.on_host_silent(BrickLink.DIRECT)
    assert sent(bench) == [7, 8]


@pytest.mark.parametrize("link", list(BrickLink))
def test_a_stop_goes_past_what_waits_and_ends_it(bench: Bench, link: BrickLink) -> None:
    at_work(bench)
    bench.command(link, stop(9))
    assert sent(bench) == [1, 9]
    assert by_relay(bench) == [(2, "CANCELLED"), (3, "CANCELLED")]
    bench.command(BrickLink.RELAY, forward(4), forward(2))
    assert reported(bench) == [(BrickLink.RELAY, 4, "RECEIVED"), (BrickLink.RELAY, 2, "CANCELLED")]
    bench.sends(replace(executed(forward(1)), executed=False, outputs=("CANCELLED", "STOPPED", "")))
    assert sent(bench) == [1, 9]
    bench.sends(executed(stop(9)))
    assert sent(bench) == [1, 9, 4]


def test_a_stop_that_a_brick_away_cannot_have_ends_what_waits_all_the_same(bench: Bench) -> None:
    at_work(bench, 2)
    bench.ports.there = False
    bench.start(bench.router.record)
    bench.router.on_disconnected(RESTARTED)
    bench.command(BrickLink.RELAY, stop(9))
    assert [stage for _, _, stage in reported(bench)] == ["FAILED", "CANCELLED", "REJECTED"]
    bench.ports.there = True
    bench.router.on_connected(1)
    assert sent(bench) == [1]


def test_a_brick_that_answers_a_stop_has_ended_its_unanswered_commands(bench: Bench) -> None:
    at_work(bench, 1)
    bench.command(BrickLink.RELAY, stop(9), forward(2))
    bench.sends(executed(stop(9)))
    bench.router.poll()
    assert by_relay(bench) == [(2, "RECEIVED"), (9, "EXECUTED")]
    bench.router.poll()
    assert reported(bench) == [(BrickLink.RELAY, 1, "FAILED")]
    assert sent(bench) == [1, 9, 2]


def test_a_reply_after_an_answered_stop_counts(bench: Bench) -> None:
    at_work(bench, 1)
    bench.command(BrickLink.RELAY, stop(9))
    bench.sends(executed(stop(9)), executed(forward(1)))
    bench.router.poll()
    bench.router.poll()
    assert by_relay(bench) == [(9, "EXECUTED"), (1, "EXECUTED")]


def test_an_excess_command_is_refused_also_when_repeated(bench: Bench) -> None:
    at_work(bench, MAX_QUEUED + 1)
    late = forward(99)
    bench.command(BrickLink.RELAY, late)
    ((_, refusal),) = bench.ports.notified
    assert (refusal.outputs[:2], refusal.received) == (("REJECTED", "QUEUE_FULL"), False)
    assert refusal.outputs[2].startswith("BUSY")
    reported(bench)
    bench.sends(executed(forward(1)))
    bench.command(BrickLink.RELAY, late)
    assert reported(bench)[-1] == (BrickLink.RELAY, 99, "REJECTED")


def test_what_waits_outlives_the_process_but_not_the_cable(tmp_path: Path) -> None:
    bench = Bench()
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    at_work(bench, 4)
    bench.router.record.close()
    bench.ports.there = False
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    bench.router.on_disconnected(RESTARTED)
    assert reported(bench) == [(BrickLink.RELAY, 1, "FAILED")]
    bench.ports.there = True
    bench.router.on_connected(1)
    assert sent(bench) == [1], "what it does nobody knows: it is stopped before it goes on"
    bench.sends(executed(bench.halted()))
    assert sent(bench) == [1, 2]
    bench.ports.there = False
    bench.router.on_disconnected()
    closed = [message.outputs for _, message in bench.ports.notified]
    assert closed[1:] == [("CANCELLED", "", "the brick disconnected before it was sent")] * 2
    ends = [
        (BrickLink.RELAY, 2, "FAILED"),
        (BrickLink.RELAY, 3, "CANCELLED"),
        (BrickLink.RELAY, 4, "CANCELLED"),
    ]
    assert reported(bench) == ends
    bench.command(BrickLink.RELAY, forward(5), forward(3))
    assert reported(bench) == [(BrickLink.RELAY, 5, "REJECTED"), (BrickLink.RELAY, 3, "CANCELLED")]
    bench.ports.there = True
    bench.router.on_connected(1)
    bench.command(BrickLink.RELAY, forward(6))
    bench.sends(executed(bench.halted()))
    assert sent(bench) == [1, 2, 6]


def test_a_command_that_the_brick_cannot_accept_yet_waits_further(bench: Bench) -> None:
    at_work(bench)
    bench.ports.there = False
    bench.sends(executed(forward(1)))
    bench.ports.there = True
    assert (sent(bench), bench.router.counts.queued) == ([1], 2)
    bench.router.poll()
    bench.router.poll()
    assert (sent(bench), bench.router.counts.queued) == ([1, 2], 1)


def test_a_repeat_of_what_waits_is_answered_and_another_under_its_number_refused(
    bench: Bench,
) -> None:
    at_work(bench, 2)
    bench.command(BrickLink.RELAY, forward(2), forward(2, distance="9.0"))
    bench.command(BrickLink.DIRECT, forward(2))
    assert reported(bench) == [
        (BrickLink.RELAY, 2, "RECEIVED"),
        (BrickLink.RELAY, 2, "REJECTED"),
        (BrickLink.DIRECT, 2, "RECEIVED"),
    ]
    bench.router.resend_last(BrickLink.RELAY)
    assert reported(bench) == [(BrickLink.RELAY, 2, "RECEIVED")]
    assert sent(bench) == [1]


def test_what_ended_on_a_full_disk_is_not_sent_later(
    bench: Bench,
) -> None:
    at_work(bench, 2)
    bench.fill_disk(True)
    bench.router.on_disconnected()
    bench.router.on_connected(1)
    bench.fill_disk(False)
    bench.router.poll()
    assert sent(bench) == [1]
    assert reported(bench) == [(BrickLink.RELAY, 1, "FAILED"), (BrickLink.RELAY, 2, "CANCELLED")]
