"""A command of the relay has one end, whatever is not recorded, absent or sent again."""

from dataclasses import replace

import pytest

from adapters.mocup.brick.record import BrickLink
from adapters.mocup.brick.router import RESTARTED
from adapters.mocup.brick.service import BrickService
from adapters.mops import CommandConditions, Message, RelayAuthority, encode, fingerprint
from executive.values.reports import Identity
from tests.mocup.brick.routing import (
    DICTIONARY,
    Bench,
    claimed,
    executed,
    forward,
    part,
    report,
    stop,
)


def ends(bench: Bench) -> list[str]:
    """Return the last replies that the relay received, each once."""
    stages = [each.outputs[0] for to, each in bench.ports.notified if to is BrickLink.RELAY]
    return [stage for stage in dict.fromkeys(stages) if stage not in ("RECEIVED", "STARTED")]


def plug(bench: Bench, there: bool) -> None:
    bench.ports.there = there
    if there:
        bench.router.on_connected(1)
    else:
        bench.router.on_disconnected()


def restart(bench: Bench) -> None:
    bench.start(bench.router.record)
    bench.router.on_disconnected(RESTARTED)
    bench.router.on_connected(1)


@pytest.mark.parametrize("command", [forward(1), stop(1)])
def test_a_command_refused_without_a_brick_is_refused_when_repeated(
    bench: Bench, command: Message
) -> None:
    plug(bench, False)
    assert bench.command(BrickLink.RELAY, command)
    plug(bench, True)
    assert bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    assert ends(bench) == ["REJECTED"]
    assert encode(forward(1)) not in bench.ports.brick


def test_a_command_refused_without_authority_is_refused_also_after_a_hand_over(
    bench: Bench,
) -> None:
    bench.authority = RelayAuthority(needed=True)
    restart(bench)
    bench.command(BrickLink.RELAY, forward(1))
    bench.authority = RelayAuthority(needed=False)
    restart(bench)
    bench.command(BrickLink.RELAY, forward(1))
    assert ends(bench) == ["REJECTED"]
    assert bench.ports.brick == []


def test_a_command_created_ahead_of_the_clock_is_refused_also_later(bench: Bench) -> None:
    conditions = CommandConditions(created_utc_s=bench.clock.utc_s() + 60.0, lifetime_s=600.0)
    request = DICTIONARY.request(forward(1))
    command = DICTIONARY.command(request, Identity("MOE", 1), "MOCUP", conditions)
    bench.command(BrickLink.RELAY, command)
    bench.clock.advance(60.0)
    bench.command(BrickLink.RELAY, command)
    assert ends(bench) == ["REJECTED"]
    assert bench.ports.brick == []


def test_a_precondition_is_refused_and_never_passed_over(bench: Bench) -> None:
    for number, only in enumerate(("0.0 0.0 1.0", "here"), 1):
        conditions = CommandConditions(only_at=only)
        request = DICTIONARY.request(forward(1))
        command = DICTIONARY.command(request, Identity("MOE", number), "MOCUP", conditions)
        bench.command(BrickLink.RELAY, command)
        assert bench.ports.notified[-1][1].moe_inputs_id == number
    assert ends(bench) == ["REJECTED"]
    assert bench.ports.brick == []


def test_an_executed_stop_remains_executed_when_repeated(bench: Bench) -> None:
    bench.command(BrickLink.RELAY, stop(1))
    bench.sends(executed(stop(1)))
    bench.command(BrickLink.RELAY, stop(1))
    assert bench.ports.brick == 2 * [encode(stop(1))], "it stops each time"
    restart(bench)
    plug(bench, False)
    bench.command(BrickLink.RELAY, stop(1))
    assert ends(bench) == ["EXECUTED"]


@pytest.mark.parametrize("is_repeat", [False, True])
def test_commands_dropped_by_a_stop_end_although_the_stop_is_not_recorded_again(
    bench: Bench, is_repeat: bool
) -> None:
    if is_repeat:
        bench.command(BrickLink.RELAY, stop(1))
        bench.sends(executed(stop(1)))
    bench.command(BrickLink.RELAY, forward(2))
    bench.fill_disk(True)
    bench.command(BrickLink.RELAY, stop(1))
    bench.fill_disk(False)
    bench.sends(executed(stop(1)))
    bench.ports.notified.clear()
    bench.router.poll()
    bench.router.poll()
    assert ends(bench) == ["FAILED"]
    bench.command(BrickLink.RELAY, forward(3))
    assert bench.ports.brick[-1] == encode(forward(3)), "what comes then need not wait"


@pytest.mark.parametrize(("dies", "end"), [(False, "EXECUTED"), (True, "FAILED")])
def test_an_end_that_cannot_be_recorded_is_reported_once_it_can_be(
    bench: Bench, dies: bool, end: str
) -> None:
    bench.command(BrickLink.RELAY, forward(1))
    bench.fill_disk(True)
    bench.sends(executed(forward(1)))
    bench.router.poll()
    assert ends(bench) == []
    bench.fill_disk(False)
    if dies:
        restart(bench)
    else:
        plug(bench, False)
    assert ends(bench) == [end]


def test_a_recorded_command_that_did_not_reach_the_brick_ends(bench: Bench) -> None:
    bench.ports.there = False  # and the router does not know it yet
    refuse = bench.ports.to_brick

    def fill_disk(octets: bytes, visit: int) -> bool:
        bench.fill_disk(True)
        return refuse(octets, visit)

    bench.ports.to_brick = fill_disk  # type: ignore[method-assign]
    bench.command(BrickLink.RELAY, forward(1))
    bench.fill_disk(False)
    bench.router.poll()
    assert ends(bench) == ["REJECTED"]
    bench.command(BrickLink.RELAY, forward(1))
    assert ends(bench) == ["REJECTED"]


@pytest.mark.parametrize("counter", [None, 1])
def test_a_command_refused_for_the_relay_is_executed_once_for_the_executive(
    bench: Bench, counter: int | None
) -> None:
    copy = replace(forward(7), moe_inputs_counter=counter)
    plug(bench, False)
    bench.command(BrickLink.RELAY, copy)
    plug(bench, True)
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1), part(7, 1))
    assert bench.ports.brick == [encode(part(7, 1))]
    bench.command(BrickLink.DIRECT, report(forward(7), "EXECUTED"))
    bench.command(BrickLink.RELAY, copy)
    bench.router.resend_last(BrickLink.RELAY)
    assert ends(bench) == ["REJECTED"]


def test_the_end_of_a_part_is_recorded_once_possible_so_that_the_relay_need_not_wait(
    bench: Bench,
) -> None:
    bench.command(BrickLink.DIRECT, claimed(forward(7)), part(7, 1))
    bench.command(BrickLink.RELAY, forward(8))
    bench.fill_disk(True)
    bench.sends(executed(part(7, 1)))
    assert executed(part(7, 1)) in [
        each for to, each in bench.ports.notified if to is BrickLink.DIRECT
    ]
    bench.command(BrickLink.DIRECT, report(forward(7), "EXECUTED"))
    bench.fill_disk(False)
    bench.router.poll()
    assert bench.ports.brick[-1] == encode(forward(8))


def test_a_claim_of_the_executive_is_confirmed_once_it_is_recorded(bench: Bench) -> None:
    marks: list[tuple[BrickLink, int]] = []
    service = BrickService(bench.router, lambda *mark: marks.append(mark), confirmed=True)
    text = f"{claimed(forward(7))}{report(forward(7), 'EXECUTED')}"
    for full in (True, False):
        bench.fill_disk(full)
        assert service.inbox.put(BrickLink.DIRECT, text)
        service.serve()
        assert marks == ([] if full else [(BrickLink.DIRECT, fingerprint(text))])
    bench.command(BrickLink.RELAY, forward(7))
    assert ends(bench) == ["EXECUTED"]
    assert bench.ports.brick == []


def test_a_reply_is_sent_again_until_rover_relay_has_stored_it(bench: Bench) -> None:
    service = BrickService(bench.router, lambda *_: None, confirmed=True)
    listeners: dict[BrickLink, frozenset[object]] = {link: frozenset({1}) for link in BrickLink}
    bench.router.on_connected(1)
    bench.command(BrickLink.RELAY, forward(1))
    bench.sends(executed(forward(1)))
    ((_, reply),) = bench.ports.notified
    service.poll({link: frozenset() for link in BrickLink})
    service.poll(listeners)
    bench.ports.notified.clear()
    service.poll(listeners)
    assert bench.ports.notified == [(BrickLink.RELAY, reply)]
    service.on_confirmed(fingerprint(str(reply)))
    service.poll(listeners)
    assert len(bench.ports.notified) == 1
