"""What stands before the brick hears which commands the executive carries out."""

from pathlib import Path

from adapters.mocup.claims import Claims
from adapters.mops.dictionary import load_dictionary
from adapters.mops.message import Message
from executive.commands import FollowPath, MoveForward, SetTravelSpeed, Waypoint
from executive.reports import Stage
from tests.support.self_moving import SelfMovingBench


def heard(bench: SelfMovingBench) -> list[Message]:
    sent: list[Message] = []
    claims = Claims(load_dictionary(), bench.executive.ledger.request, sent.append, "MOCUP")
    for report in bench.heard.reports:
        claims.report(report)
    return sent


def test_a_command_is_claimed_when_it_is_accepted_and_then_reported_on(tmp_path: Path) -> None:
    bench = SelfMovingBench(tmp_path)
    bench.run(0.2)
    bench.submit(MoveForward(1.5), 7)
    assert bench.finish(7) is Stage.EXECUTED
    claim, *told = heard(bench)
    assert str(claim).split("|")[1:9] == [
        "MOE", "MOCUP", "MOVE_FORWARD", "1.5", "", "True", "False", "7",
    ]  # fmt: skip
    assert [m.outputs[0] for m in told] == ["ACCEPTED", "STARTED", "EXECUTED"]
    assert all((m.source, m.dest, m.moe_inputs_id) == ("MOCUP", "MOE", 7) for m in told)


def test_what_is_refused_or_cannot_be_a_message_is_not_claimed(tmp_path: Path) -> None:
    bench = SelfMovingBench(tmp_path)
    bench.run(0.2)
    bench.submit(SetTravelSpeed(500.0), 1)
    bench.submit(FollowPath((Waypoint(0.1, 0.0),)), 2)
    bench.submit(SetTravelSpeed(0.2), 3)
    bench.run(0.2)
    spelled = {m.moe_inputs_id for m in heard(bench)}
    assert 3 in spelled
    assert 1 not in spelled
