"""`rover inject`: a command for each fault of a simulation that runs."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from sim.ros import inject as inject_command
from sim.ros.inject import inject
from tests.support.processes import simulation

pytestmark = pytest.mark.ros


def rover_inject(*words: str) -> Result:
    return CliRunner().invoke(inject, words)


@pytest.mark.usefixtures("ros_domain")
def test_a_fault_begins_and_ends_as_it_is_told(tmp_path: Path) -> None:
    with simulation(tmp_path, "--camera", "off") as process:
        for words, says in (
            (("tip", "--by", "90deg"), "injected"),
            (("tip", "--clear"), "cleared"),
            (("motor_dead", "--side", "left"), "injected"),
        ):
            result = rover_inject(*words)
            assert (result.exit_code, result.output) == (0, f"jackal: {words[0]} {says}\n")
        process.said(r"fault injected: {'tip': {'by': 1.57079")
        process.said(r"fault cleared: tip")
        process.said(r"fault injected: {'motor_dead': {'side': 'left'}}")
        assert process.end() == 0


@pytest.mark.usefixtures("ros_domain")
def test_where_no_simulation_runs_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inject_command, "DISCOVERY_S", 0.2)
    result = rover_inject("slip")
    assert isinstance(result.exception, TimeoutError)
    assert "no simulation of jackal answers in ROS domain" in str(result.exception)
    assert "rover-sim starts one" in str(result.exception)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("slop",), "No such command 'slop'. Did you mean 'slip'?"),
        (("slip", "--factor", "7"), "slip.factor: 7 is not in 0.01 .. 1"),
        (("tip", "--by", "far"), "expected a number (radians, or degrees as 90deg), got 'far'"),
        (("motor_dead", "--side", "top"), "'top' is not one of 'left', 'right', 'both'"),
        (("slip", "--factor", "0.5", "--clear"), "--clear ends the fault: leave --factor out"),
        (("slip", "--asset", "nobody"), "there is no asset 'nobody'"),
        (("link_lost",), "No such command 'link_lost'"),
    ],
)
def test_what_makes_no_sense_is_refused_with_status_2(words: tuple[str, ...], says: str) -> None:
    result = rover_inject(*words)
    assert result.exit_code == 2
    assert says in result.output
