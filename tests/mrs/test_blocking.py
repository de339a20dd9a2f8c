"""The client in which nothing is awaited."""

import threading

import pytest

from adapters.mal import MalError
from adapters.mrs.ground import BlockingClient, MrsClient
from adapters.mrs.spec import ReceivedReport, Stage
from executive.commands import MoveForward
from tests.mrs.aboard import Aboard


def sessions() -> int:
    return sum(thread.name == "mrs session" for thread in threading.enumerate())


def test_a_rover_is_commanded_and_queried_step_by_step(running: Aboard) -> None:
    reported: list[ReceivedReport] = []
    with BlockingClient(running.uri, source="LAB") as rover:
        assert rover.run(MoveForward(1.0), reported.append).executed
        assert rover.call(MrsClient.get_pose).x == pytest.approx(1.0, abs=0.05)
        refused = rover.run(MoveForward(1000.0))
        assert refused.stage is Stage.REJECTED
        with pytest.raises(MalError):
            rover.call(lambda client: client.preview(MoveForward(1000.0)))
        assert sessions() == 1
    assert [each.report.stage for each in reported if each.report.stage][-1] is Stage.EXECUTED
    assert sessions() == 0


def test_without_an_answer_no_thread_is_left() -> None:
    with pytest.raises(ConnectionError):
        BlockingClient("127.0.0.1:1")
    assert sessions() == 0
