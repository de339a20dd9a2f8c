"""What the relay may have MOCUP do: what `rover-nxt` was told, over its restarts and without it."""

from dataclasses import replace
from urllib.parse import unquote

import pytest

from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mops import Message, RelayAuthority, authority_message, decode
from executive.values.reasons import Reason
from tests.mocup.brick.routing import BOTH, SPELLING, Bench, executed, forward, part, stop

MOE_HOLDS = RelayAuthority(True, "MOE")
ORBITER_HOLDS = RelayAuthority(True, "MOPS", 7, "MOE")


@pytest.fixture
def bench() -> Bench:
    return Bench()


def log(bench: Bench, authority: RelayAuthority) -> None:
    reported = authority_message(authority, SPELLING.authority, "EXEC", "MOCUP")
    bench.command(BrickLink.DIRECT, reported)


def by(epoch: int | str, command: Message) -> Message:
    return replace(command, outputs=(str(epoch),))


def requested(bench: Bench) -> list[Message]:
    return [decode(octets) for octets in bench.ports.brick]


def refusals(bench: Bench) -> list[str]:
    """Return why the relay's commands were refused for lack of authority."""
    reported = [m.outputs for link, m in bench.ports.notified if link is BrickLink.RELAY]
    return [unquote(o[2]) for o in reported if o[1:2] == (Reason.NO_AUTHORITY.name,)]


@pytest.mark.parametrize(
    ("authority", "command", "why"),
    [
        (MOE_HOLDS, forward(1), "a command needs the authority: MOE holds it"),
        (MOE_HOLDS, forward(None), "a command needs the authority: MOE holds it"),
        (MOE_HOLDS, by(7, forward(1)), "the relay does not hold authority 7: MOE holds it"),
        (RelayAuthority(True), forward(1), "a command needs the authority: no operator holds it"),
        (ORBITER_HOLDS, by(6, forward(1)), "the relay does not hold authority 6: MOPS holds it"),
        (
            ORBITER_HOLDS,
            by(7, forward(1, "MOE-2")),
            "MOE-2 is not MOE, its grantor: MOPS holds it",
        ),
        (
            RelayAuthority(False),
            by(7, forward(1)),
            "the relay does not hold authority 7: no operator",
        ),
    ],
)
def test_without_the_orbiter_s_authority_the_relay_moves_no_brick(
    bench: Bench, authority: RelayAuthority, command: Message, why: str
) -> None:
    log(bench, authority)
    bench.command(BrickLink.RELAY, command)
    assert requested(bench) == []
    (refused,) = refusals(bench)
    assert refused.startswith(why)
    assert bench.router.record.unanswered() == []


def test_by_the_orbiter_s_authority_it_acts_and_the_executive_is_notified(bench: Bench) -> None:
    log(bench, ORBITER_HOLDS)
    bench.command(BrickLink.RELAY, by(7, forward(1)), by(7, forward(2)))
    bench.sends(executed(forward(1)), executed(forward(2)))
    assert requested(bench) == [forward(1), forward(2)]
    used = [m for link, m in bench.ports.notified if link is BrickLink.DIRECT]
    assert [(m.source, m.dest, m.inputs[2]) for m in used] == [("MOCUP", "EXEC", "7")] * 2


@pytest.mark.parametrize("outputs", [("7", "1.0", "2.0", "3.0"), ("seven",), ("-1",), ("True",)])
def test_a_claim_that_makes_no_sense_moves_nothing(bench: Bench, outputs: tuple[str, ...]) -> None:
    log(bench, ORBITER_HOLDS)
    bench.command(BrickLink.RELAY, replace(forward(1), outputs=outputs))
    assert requested(bench) == []


def test_it_holds_over_restarts_and_while_the_executive_has_ended(bench: Bench) -> None:
    log(bench, ORBITER_HOLDS)
    for authority in (ORBITER_HOLDS, MOE_HOLDS):
        log(bench, authority)
        bench.start(bench.router.record)
        for _ in range(3):
            bench.router.poll()
        bench.command(BrickLink.RELAY, by(7, forward(1)), by(7, forward(2)))
        bench.sends(executed(forward(1)), executed(forward(2)))
    assert requested(bench) == [forward(1), forward(2)]
    assert refusals(bench) == [], "what comes again is answered as before, whoever holds it now"
    bench.command(BrickLink.RELAY, by(7, forward(3)))
    assert refusals(bench) == ["the relay does not hold authority 7: MOE holds it"]


def test_after_a_start_the_relay_waits_until_the_executive_has_sent_the_holder(
    bench: Bench,
) -> None:
    log(bench, ORBITER_HOLDS)
    bench.start(bench.router.record)
    assert not bench.command(BrickLink.RELAY, by(7, forward(1))), (
        "it comes again: it is not confirmed"
    )
    assert bench.command(BrickLink.RELAY, by(7, stop(2)))
    log(bench, MOE_HOLDS)
    assert bench.command(BrickLink.RELAY, by(7, forward(1)))
    assert requested(bench) == [stop(2)]
    assert len(refusals(bench)) == 1


def test_on_a_full_disk_it_holds_until_a_restart(bench: Bench) -> None:
    log(bench, ORBITER_HOLDS)
    bench.fill_disk(True)
    log(bench, MOE_HOLDS)
    bench.fill_disk(False)
    bench.command(BrickLink.RELAY, by(7, forward(1)))
    assert requested(bench) == []


@pytest.mark.parametrize("needs", [False, True])
def test_until_an_executive_has_sent_the_holder_the_settings_decide(
    bench: Bench, needs: bool
) -> None:
    bench.authority = RelayAuthority(needs)
    bench.start(BrickRecord())
    bench.command(BrickLink.RELAY, forward(1))
    assert requested(bench) == ([] if needs else [forward(1)])


def test_the_relay_does_not_publish_the_authority(bench: Bench) -> None:
    log(bench, MOE_HOLDS)
    forged = authority_message(ORBITER_HOLDS, SPELLING.authority, "EXEC", "MOCUP")
    bench.command(BrickLink.RELAY, forged, by(7, forward(1)))
    assert requested(bench) == []


@pytest.mark.parametrize("outputs", [(), ("6",), ("7",), ("a", "b")])
def test_a_stop_by_the_relay_acts_under_any_claim(bench: Bench, outputs: tuple[str, ...]) -> None:
    log(bench, MOE_HOLDS)
    bench.command(BrickLink.DIRECT, part(1, 1))
    bench.command(BrickLink.RELAY, replace(stop(2), outputs=outputs))
    assert requested(bench) == [part(1, 1), stop(2)]
    assert bench.router.is_stop(str(replace(stop(2), outputs=outputs)))


def test_commands_of_the_executive_have_its_authority(bench: Bench) -> None:
    log(bench, RelayAuthority(True))
    bench.command(BrickLink.DIRECT, part(1, 1))
    assert requested(bench) == [part(1, 1)]


@pytest.mark.parametrize("number", [None, 5])
def test_an_overtaken_command_without_a_number_moves_nothing_either(
    bench: Bench, number: int | None
) -> None:
    bench.router.process(BrickLink.RELAY, str(forward(number)), overtaken=True)
    assert requested(bench) == []


def test_a_command_overtaken_in_transmission_moves_nothing_and_a_repeat_has_its_reply(
    bench: Bench,
) -> None:
    mark = ("", "", "", "True")
    bench.command(BrickLink.RELAY, forward(4))
    bench.sends(executed(forward(4)))
    bench.command(
        BrickLink.RELAY, replace(forward(4), outputs=mark), replace(forward(5), outputs=mark)
    )
    assert requested(bench) == [forward(4)]
    reported = [(m.moe_inputs_id, m.outputs[:2]) for _, m in bench.ports.notified]
    assert reported == [(4, ("EXECUTED",)), (4, ("EXECUTED",)), (5, ("CANCELLED", "STOPPED"))]


def living(bench: Bench, number: int, lifetime_s: float, made_s: float = 0.0) -> Message:
    """Return a command that was made so many seconds from now."""
    made_utc_s = bench.clock.utc_s() + made_s
    return replace(forward(number), outputs=("", repr(made_utc_s), repr(lifetime_s)))


def test_a_command_of_the_relay_for_a_brick_is_neither_too_old_nor_made_in_an_hour(
    bench: Bench,
) -> None:
    bench.command(BrickLink.RELAY, living(bench, 1, 5.0, -6.0), living(bench, 2, 5.0, 3600.0))
    assert requested(bench) == []
    reported = [message.outputs[:2] for _, message in bench.ports.notified]
    assert reported == [("REJECTED", "EXPIRED"), ("REJECTED", "CREATED_IN_FUTURE")]
    bench.command(BrickLink.RELAY, living(bench, 3, 5.0, -1.0))
    assert requested(bench) == [forward(3)]


@pytest.mark.parametrize("restarted", [False, True])
def test_a_command_that_waits_for_the_brick_does_not_outlive_its_lifetime(
    bench: Bench, restarted: bool
) -> None:
    delayed = [living(bench, number, 5.0 * number) for number in (1, 2, 3)]
    bench.command(BrickLink.DIRECT, part(9, 1))
    bench.command(BrickLink.RELAY, *delayed)
    bench.clock.advance(12.0)
    if restarted:
        bench.start(bench.router.record)
    bench.sends(executed(part(9, 1)))
    assert requested(bench)[1:] == [forward(3)]
    ends = {
        m.moe_inputs_id: m.outputs[:2]
        for link, m in bench.ports.notified
        if link is BrickLink.RELAY
    }
    assert ends[1] == ends[2] == ("EXPIRED", "EXPIRED")


def test_a_clock_that_is_set_back_makes_nothing_live_longer_that_waits_for_the_brick(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.command(BrickLink.DIRECT, part(9, 1))
    bench.command(BrickLink.RELAY, living(bench, 1, 5.0))
    bench.clock.advance(12.0)
    monkeypatch.setattr(bench.clock, "utc_s", lambda: 1.0)
    bench.sends(executed(part(9, 1)))
    assert requested(bench) == [part(9, 1)]


@pytest.mark.parametrize("link", BOTH)
def test_only_rover_nxt_sets_its_timeout_at_the_brick(bench: Bench, link: BrickLink) -> None:
    entry = SPELLING.keep_alive
    message = Message(entry.code, "MOE", "MOCUP", entry.command, ("1e9",), moe_inputs_id=1)
    bench.command(link, message)
    assert requested(bench) == []
    assert "is no command" in bench.reported[-1]
