"""Commands that are answered by no report of their own: told until the answer is on the disk."""

from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mops import Message, fingerprint, is_last
from executive.commands.catalogue import Request, SetTravelSpeed, Stop
from executive.values.reports import Stage
from tests.relay.rover.relayed_bench import RelayedBench, request_message

SPEED = SetTravelSpeed(0.3)


def reported(bench: RelayedBench) -> list[tuple[int | None, str]]:
    return [(m.moe_inputs_id, m.outputs[0]) for m in bench.reported if m.moe_inputs_id]


@pytest.fixture
def bench(tmp_path: Path) -> RelayedBench:
    bench = RelayedBench(tmp_path)
    bench.execute(SPEED, 6)
    bench.execute(SPEED, 7)
    bench.submit(Stop(), 8)
    assert bench.finish(8) is Stage.EXECUTED
    bench.receive("")
    bench.wire.taken.clear()
    return bench


@pytest.mark.parametrize(
    ("commands", "answers"),
    [
        (
            [request_message(SPEED, 6), request_message(SPEED, 7)],
            [(6, "EXECUTED"), (7, "EXECUTED")],
        ),
        ([request_message(Stop(), 8)], [(8, "EXECUTED")]),
        ([request_message(SetTravelSpeed(0.5), 6)], [(6, "REJECTED")]),
        ([request_message(Stop(), 7)], [(7, "REJECTED")]),
        ([replace(request_message(SPEED, 9), inputs=("fast",))], [(9, "REJECTED")]),
    ],
)
def test_a_string_is_confirmed_once_its_answers_are_on_the_disk(
    bench: RelayedBench, commands: list[Message], answers: list[tuple[int, str]]
) -> None:
    text = "".join(map(str, commands))
    bench.receive(text)
    assert reported(bench) == answers
    assert bench.wire.taken == []
    bench.wire.output.clear()
    bench.crash()
    bench.receive(text)
    bench.receive(text)
    assert set(reported(bench)) == set(answers), "each time that the string comes"
    assert bench.wire.taken == []
    bench.store()
    assert bench.wire.taken == [fingerprint(text)]


def test_a_malformed_stop_that_acts_has_one_end(bench: RelayedBench) -> None:
    bench.receive(str(replace(request_message(Stop(), 9), inputs=("now",))))
    assert bench.finish(9) is Stage.EXECUTED
    bench.link.poll()
    ends = [m.outputs[0] for m in bench.reported if m.moe_inputs_id == 9 and is_last(m)]
    assert ends == ["EXECUTED"]


@pytest.mark.parametrize("killed", [False, True])
@pytest.mark.parametrize(("request_", "number"), [(SPEED, 9), (Stop(), 9), (SPEED, 6)])
def test_a_command_that_arrives_while_the_ledger_fails_has_one_end(
    bench: RelayedBench, request_: Request, number: int, killed: bool
) -> None:
    text, ends = str(request_message(request_, number)), set()
    bench.fill_disk()
    bench.receive(text)
    bench.receive(text)
    ends |= {m.outputs[0] for m in bench.reported if m.moe_inputs_id == number and is_last(m)}
    assert bench.wire.taken == []
    bench.fill_disk(False)
    if killed:
        bench.crash()
    for _ in range(2):
        bench.run(1.0)
        bench.receive(text)
        bench.run(1.0)
    bench.link.poll()
    ends |= {m.outputs[0] for m in bench.reported if m.moe_inputs_id == number and is_last(m)}
    bench.store()
    assert len(ends) == 1
    assert bench.wire.taken[-1:] == [fingerprint(text)]
