"""What stands before the brick hears which commands the executive carries out."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mocup import ClaimAnnouncer
from adapters.mops import Message, RelayAuthority, fingerprint, load_dictionary, messages_in
from executive.commands.catalogue import Command, FollowPath, MoveForward, SetTravelSpeed, Waypoint
from executive.values.reports import Identity
from tests.support.self_moving import SelfMovingBench


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[SelfMovingBench]:
    with SelfMovingBench(tmp_path) as bench:
        bench.run(0.2)
        yield bench


def claims_of(bench: SelfMovingBench, texts: list[str]) -> ClaimAnnouncer:
    authority = RelayAuthority(needed=False)
    return ClaimAnnouncer(
        load_dictionary(), bench.ledger.request, lambda: authority, texts.append, "EXEC", "MOCUP"
    )


def messages(texts: list[str]) -> list[Message]:
    refused: list[str] = []
    found = [each for text in texts for each in messages_in(text, refused.append)]
    assert not refused
    return found


def received(bench: SelfMovingBench) -> list[Message]:
    texts: list[str] = []
    claims_of(bench, texts).send_reports(bench.received.reports)
    return messages(texts)


def test_a_command_is_claimed_with_each_report_on_it(bench: SelfMovingBench) -> None:
    bench.execute(MoveForward(1.5), 7)
    spelled = received(bench)
    claims, ends = spelled[::2], spelled[1::2]
    for claim in claims:
        assert str(claim).split("|")[1:9] == [
            "MOE", "MOCUP", "MOVE_FORWARD", "1.5", "", "True", "False", "7",
        ]  # fmt: skip
    assert [m.outputs[0] for m in ends] == ["ACCEPTED", "STARTED", "EXECUTED"]
    assert all((m.source, m.dest, m.moe_inputs_id) == ("MOCUP", "MOE", 7) for m in ends)


def test_a_refused_or_unencodable_command_is_not_claimed(bench: SelfMovingBench) -> None:
    bench.submit(SetTravelSpeed(500.0), 1)
    bench.submit(FollowPath((Waypoint(0.1, 0.0),)), 2)
    bench.submit(SetTravelSpeed(0.2), 3)
    bench.send(Command(Identity("Mission control", 4), SetTravelSpeed(0.3), "direct"))
    bench.run(0.2)
    spelled = {m.moe_inputs_id for m in received(bench)}
    assert 3 in spelled
    assert not spelled & {1, 4}


def test_an_absent_peer_receives_the_last_reply_to_each_command_with_its_claim(
    bench: SelfMovingBench,
) -> None:
    bench.submit(SetTravelSpeed(0.2), 6)
    bench.execute(MoveForward(1.5), 7)
    texts: list[str] = []
    claims_of(bench, texts).resend(bench.executive.reports())
    authority, *claims = messages(texts)
    assert authority.inputs == ("False", "", "", "")
    message = [(m.moe_inputs_id, m.outputs[:1], m.received) for m in claims]
    assert message == [
        (6, (), True),
        (6, ("EXECUTED",), True),
        (7, (), True),
        (7, ("EXECUTED",), True),
    ]


def test_the_last_on_each_command_is_published_until_it_is_confirmed(
    bench: SelfMovingBench,
) -> None:
    bench.execute(SetTravelSpeed(0.2), 6)
    bench.execute(MoveForward(1.5), 7)
    texts: list[str] = []
    claims = claims_of(bench, texts)
    claims.send_reports(bench.received.reports)
    ends = [text for text in texts if "EXECUTED" in text]
    texts.clear()
    claims.poll()
    assert texts == []
    claims.poll()
    assert texts == ends
    claims.on_acknowledged(fingerprint(ends[0]))
    claims.poll()
    assert texts == [*ends, ends[1]]
