"""What comes by the relay while the brick is at work waits, and ends in one way or another."""

import sqlite3
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mocup.brick.ownership import MOST_WAITING
from adapters.mocup.brick.record import BrickRecord, Claim, Link
from adapters.mocup.brick.router import RESTARTED
from adapters.mops import Message, encode
from adapters.mops.codec import LONGEST
from tests.mocup.brick.routing import Bench, claimed, executed, forward, part, report, stop

OLD_SCHEMA = """
CREATE TABLE asked (
    number INTEGER PRIMARY KEY, source TEXT NOT NULL, moe_id INTEGER NOT NULL,
    counter INTEGER NOT NULL, command TEXT NOT NULL, links TEXT NOT NULL, replied TEXT,
    ended INTEGER NOT NULL, UNIQUE (source, moe_id, counter)
);
"""


def sent(bench: Bench) -> list[int]:
    return [int(octets.split(b"|")[8]) for octets in bench.ports.brick]


def told(bench: Bench) -> list[tuple[Link, int | None, str]]:
    """Return what was told since the last call."""
    heard = [(link, m.moe_inputs_id, m.outputs[0]) for link, m in bench.ports.notified]
    bench.ports.notified.clear()
    return heard


def by_relay(bench: Bench) -> list[tuple[int | None, str]]:
    return [(number, stage) for link, number, stage in told(bench) if link is Link.RELAY]


def at_work(bench: Bench, count: int = 3) -> None:
    """Have the brick at the first of some commands of the relay."""
    bench.command(Link.RELAY, *(forward(number) for number in range(1, count + 1)))
    told(bench)


def test_what_comes_at_once_is_received_and_done_one_after_the_other(bench: Bench) -> None:
    bench.command(Link.RELAY, *(forward(number) for number in range(1, 6)))
    assert told(bench) == [(Link.RELAY, number, "RECEIVED") for number in range(2, 6)]
    for number in range(1, 6):
        assert sent(bench) == list(range(1, number + 1))
        bench.says(executed(forward(number)))
    assert told(bench) == [(Link.RELAY, number, "EXECUTED") for number in range(1, 6)]


def test_it_waits_until_the_executive_has_done_with_what_it_does_in_parts(bench: Bench) -> None:
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    bench.command(Link.RELAY, forward(8))
    bench.says(executed(part(7, 1)))
    assert sent(bench) == [7]
    bench.command(Link.DIRECT, part(7, 2))
    bench.says(executed(part(7, 2)))
    assert sent(bench) == [7, 7]
    bench.command(Link.DIRECT, report(forward(7), "EXECUTED"))
    assert sent(bench) == [7, 7, 8]


def test_it_does_not_wait_for_an_executive_that_is_gone(bench: Bench) -> None:
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    bench.command(Link.RELAY, forward(8))
    bench.says(executed(part(7, 1)))
    bench.router.executive_gone()
    bench.router.look()
    assert sent(bench) == [7, 8]


def test_a_brick_that_is_back_is_not_kept_for_the_executive(bench: Bench) -> None:
    bench.command(Link.DIRECT, claimed(forward(7)), part(7, 1))
    bench.router.lost()
    bench.router.found(1)
    bench.command(Link.RELAY, forward(8))
    assert sent(bench) == [7, 8]


@pytest.mark.parametrize("link", list(Link))
def test_a_stop_goes_past_what_waits_and_ends_it(bench: Bench, link: Link) -> None:
    at_work(bench)
    bench.command(link, stop(9))
    assert sent(bench) == [1, 9]
    assert by_relay(bench) == [(2, "CANCELLED"), (3, "CANCELLED")]
    bench.command(Link.RELAY, forward(4), forward(2))
    assert told(bench) == [(Link.RELAY, 4, "RECEIVED"), (Link.RELAY, 2, "CANCELLED")]
    bench.says(replace(executed(forward(1)), executed=False, outputs=("CANCELLED", "STOPPED", "")))
    assert sent(bench) == [1, 9]
    bench.says(executed(stop(9)))
    assert sent(bench) == [1, 9, 4]


def test_a_stop_that_a_brick_away_cannot_have_ends_what_waits_all_the_same(bench: Bench) -> None:
    at_work(bench, 2)
    bench.ports.there = False
    bench.start(bench.router.record)
    bench.router.lost(RESTARTED)
    bench.command(Link.RELAY, stop(9))
    assert [stage for _, _, stage in told(bench)] == ["FAILED", "REJECTED", "CANCELLED"]
    bench.ports.there = True
    bench.router.found(1)
    assert sent(bench) == [1]


def test_a_brick_that_answers_a_stop_has_done_with_what_it_did_not_answer(bench: Bench) -> None:
    at_work(bench, 1)
    bench.command(Link.RELAY, stop(9), forward(2))
    bench.says(executed(stop(9)))
    bench.router.look()
    assert by_relay(bench) == [(2, "RECEIVED"), (9, "EXECUTED")]
    bench.router.look()
    assert told(bench) == [(Link.RELAY, 1, "FAILED")]
    assert sent(bench) == [1, 9, 2]


def test_what_a_brick_says_of_what_it_did_after_it_answered_a_stop_counts(bench: Bench) -> None:
    at_work(bench, 1)
    bench.command(Link.RELAY, stop(9))
    bench.says(executed(stop(9)), executed(forward(1)))
    bench.router.look()
    bench.router.look()
    assert by_relay(bench) == [(9, "EXECUTED"), (1, "EXECUTED")]


def test_what_is_too_much_is_refused_and_may_come_again(bench: Bench) -> None:
    at_work(bench, MOST_WAITING + 1)
    late = forward(99)
    bench.command(Link.RELAY, late)
    ((_, refusal),) = bench.ports.notified
    assert (refusal.outputs[:2], refusal.received) == (("REJECTED", "QUEUE_FULL"), False)
    assert refusal.outputs[2].startswith("BUSY")
    told(bench)
    bench.says(executed(forward(1)))
    bench.command(Link.RELAY, late)
    assert told(bench)[-1] == (Link.RELAY, 99, "RECEIVED")


def test_what_waits_outlives_the_process_but_not_the_cable(tmp_path: Path) -> None:
    bench = Bench()
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    at_work(bench, 4)
    bench.router.record.close()
    bench.ports.there = False
    bench.start(BrickRecord(tmp_path / "nxt.sqlite"))
    bench.router.lost(RESTARTED)
    assert told(bench) == [(Link.RELAY, 1, "FAILED")]
    bench.ports.there = True
    bench.router.found(1)
    assert sent(bench) == [1, 2]
    bench.ports.there = False
    bench.router.lost()
    gone = [message.outputs for _, message in bench.ports.notified]
    assert gone[1:] == [("CANCELLED", "", "the brick went away before it had it")] * 2
    ends = [(Link.RELAY, 2, "FAILED"), (Link.RELAY, 3, "CANCELLED"), (Link.RELAY, 4, "CANCELLED")]
    assert told(bench) == ends
    bench.command(Link.RELAY, forward(5), forward(3))
    assert told(bench) == [(Link.RELAY, 5, "REJECTED"), (Link.RELAY, 3, "CANCELLED")]
    bench.ports.there = True
    bench.router.found(1)
    bench.command(Link.RELAY, forward(6))
    assert sent(bench) == [1, 2, 6]


def test_what_the_brick_cannot_take_yet_goes_on_waiting(bench: Bench) -> None:
    at_work(bench)
    bench.ports.there = False
    bench.says(executed(forward(1)))
    bench.ports.there = True
    assert (sent(bench), bench.router.counts.waiting) == ([1], 2)
    bench.router.look()
    bench.router.look()
    assert (sent(bench), bench.router.counts.waiting) == ([1, 2], 1)


def test_a_repeat_of_what_waits_is_answered_and_another_under_its_number_refused(
    bench: Bench,
) -> None:
    at_work(bench, 2)
    bench.command(Link.RELAY, forward(2), forward(2, distance="9.0"))
    bench.command(Link.DIRECT, forward(2))
    assert told(bench) == [
        (Link.RELAY, 2, "RECEIVED"),
        (Link.RELAY, 2, "REJECTED"),
        (Link.DIRECT, 2, "RECEIVED"),
    ]
    bench.router.resend_last(Link.RELAY)
    assert told(bench) == [(Link.RELAY, 2, "RECEIVED")]
    assert sent(bench) == [1]


@pytest.mark.parametrize("claim", [(claimed(forward(2)),), ()])
def test_what_waits_the_executive_may_carry_out(bench: Bench, claim: tuple[Message, ...]) -> None:
    at_work(bench)
    bench.command(Link.DIRECT, *claim, part(2, 1), report(forward(2), "EXECUTED"))
    assert told(bench) == [(Link.RELAY, 2, "EXECUTED")]
    bench.says(executed(forward(1)), executed(part(2, 1)))
    assert bench.ports.brick[1:] == [encode(part(2, 1)), encode(forward(3))]


def test_what_a_killed_process_left_waiting_beside_its_claim_is_the_executives(
    bench: Bench,
) -> None:
    at_work(bench)
    bench.router.record.save_claim(Claim(forward(2)))
    bench.says(executed(forward(1)))
    assert sent(bench) == [1, 3]
    told(bench)
    bench.command(Link.DIRECT, report(forward(2), "EXECUTED"))
    assert told(bench) == [(Link.RELAY, 2, "EXECUTED")]


def test_another_command_that_the_executive_claims_under_the_number_does_not_end_it(
    bench: Bench,
) -> None:
    at_work(bench, 2)
    bench.command(Link.DIRECT, claimed(forward(2, distance="9.0")))
    assert told(bench) == [(Link.DIRECT, 2, "REJECTED")]
    bench.says(executed(forward(1)))
    assert bench.ports.brick[1:] == [encode(forward(2))]


def test_what_a_brick_that_went_away_did_not_have_on_a_full_disk_is_not_sent_later(
    tmp_path: Path,
) -> None:
    bench = Bench()
    record = BrickRecord(tmp_path / "nxt.sqlite")
    bench.start(record)
    at_work(bench, 2)
    record._db.execute("PRAGMA query_only = ON")
    bench.router.lost()
    bench.router.found(1)
    record._db.execute("PRAGMA query_only = OFF")
    bench.router.look()
    assert sent(bench) == [1]
    assert told(bench) == [(Link.RELAY, 1, "FAILED"), (Link.RELAY, 2, "CANCELLED")]


def test_what_was_stopped_on_a_full_disk_is_not_sent_later(tmp_path: Path) -> None:
    bench = Bench()
    record = BrickRecord(tmp_path / "nxt.sqlite")
    bench.start(record)
    at_work(bench, 2)
    record._db.execute("PRAGMA query_only = ON")
    bench.command(Link.RELAY, stop(9))
    bench.says(executed(stop(9)))
    record._db.execute("PRAGMA query_only = OFF")
    bench.router.lost()
    bench.router.found(1)
    assert sent(bench) == [1, 9]
    assert (Link.RELAY, 2, "CANCELLED") in told(bench)


def test_what_waits_for_long_is_not_forgotten_before_its_time(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adapters.mocup.brick.record.KEPT", 3)
    at_work(bench, 2)
    bench.command(Link.DIRECT, *(forward(number) for number in range(10, 20)))
    assert [each.command for each in bench.router.record.waiting()] == [forward(2)]


def test_what_no_reply_fits_to_does_not_wait(bench: Bench) -> None:
    source = "M" * (LONGEST - len(encode(forward(source="M"))) + 1)
    at_work(bench, 1)
    bench.command(Link.RELAY, forward(2, source))
    assert bench.told
    bench.says(executed(forward(1)))
    assert sent(bench) == [1]


def test_a_file_of_before_anything_waited_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "nxt.sqlite"
    with sqlite3.connect(path) as old:
        old.executescript(OLD_SCHEMA)
        row = ("MOE", 1, -1, str(forward(1)), "relay", None, False)
        old.execute("INSERT INTO asked VALUES (1, ?, ?, ?, ?, ?, ?, ?)", row)
    old.close()
    bench = Bench()
    bench.start(BrickRecord(path))
    bench.router.lost(RESTARTED)
    assert told(bench) == [(Link.RELAY, 1, "FAILED")]
    bench.router.record.close()
    BrickRecord(path).close()
