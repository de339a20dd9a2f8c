"""Commands that a stop overtook on their way: the executive, which alone knows, ends them."""

from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mops import Message
from executive.commands.catalogue import MoveForward, Request, Resume, SetTravelSpeed, Stop
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.relay.rover.relayed_bench import RelayedBench, request_message


def overtaken(request: Request, number: int) -> Message:
    return replace(request_message(request, number), outputs=("", "", "", "True"))


@pytest.mark.parametrize("request_", [MoveForward(1.0), SetTravelSpeed(0.3), Resume()])
def test_an_overtaken_command_is_refused_also_after_a_resume(
    tmp_path: Path, request_: Request
) -> None:
    with RelayedBench(tmp_path) as bench:
        bench.execute(Stop(), 8)
        bench.execute(Resume(), 9)
        bench.receive(str(overtaken(request_, 7)))
        assert bench.stages(7) == [Stage.RECEIVED, Stage.REJECTED]
        assert bench.last(7).reason is Reason.STOPPED
        bench.receive(str(request_message(request_, 7)))
        assert bench.stages(7)[2:] == [Stage.REJECTED], "the same end again"


@pytest.mark.parametrize("link", ["relay", "direct"])
def test_an_overtaken_command_executed_before_has_that_end_alone(tmp_path: Path, link: str) -> None:
    with RelayedBench(tmp_path) as bench:
        if link == "relay":
            bench.receive(str(request_message(MoveForward(1.0), 7)))
        else:
            bench.submit(MoveForward(1.0), 7)
        bench.run(1.0)
        bench.crash()
        assert bench.finish(7) is Stage.FAILED
        bench.receive(str(request_message(Stop(), 8)))
        bench.receive(str(overtaken(MoveForward(1.0), 7)))
        bench.link.poll()
        ends = [m.outputs[0] for m in bench.reported if m.moe_inputs_id == 7]
        assert ends[-1] == "FAILED"
        assert "REJECTED" not in ends


def test_a_stop_acts_even_if_overtaken(tmp_path: Path) -> None:
    with RelayedBench(tmp_path) as bench:
        bench.receive(str(overtaken(Stop(), 7)))
        assert bench.finish(7) is Stage.EXECUTED
