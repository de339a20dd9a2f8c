"""`rover inject`: a command for each fault of a simulation that runs."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from sim.ros import inject as inject_command
from sim.ros.inject import inject
from tests.support.processes import simulation

pytestmark = pytest.mark.ros


def rover_inject(*texts: str) -> Result:
    return CliRunner().invoke(inject, texts)


@pytest.mark.usefixtures("ros_domain")
def test_a_fault_begins_and_ends_as_requested(tmp_path: Path) -> None:
    with simulation(tmp_path, "--camera", "off") as process:
        for texts, text in (
            (("tip", "--by", "90deg"), "injected"),
            (("tip", "--clear"), "cleared"),
            (("motor_dead", "--side", "left"), "injected"),
        ):
            result = rover_inject(*texts)
            assert (result.exit_code, result.output) == (0, f"jackal: {texts[0]} {text}\n")
        process.output(r"fault injected: {'tip': {'by': 1.57079")
        process.output(r"fault cleared: tip")
        process.output(r"fault injected: {'motor_dead': {'side': 'left'}}")
        assert process.end() == 0


@pytest.mark.usefixtures("ros_domain")
def test_without_a_simulation_it_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inject_command, "DISCOVERY_S", 0.2)
    result = rover_inject("low_friction")
    assert isinstance(result.exception, TimeoutError)
    assert "no simulation of jackal answers in ROS domain" in str(result.exception)
    assert "rover-sim starts one" in str(result.exception)


@pytest.mark.parametrize(
    ("texts", "text"),
    [
        (("low_frictio",), "No such command 'low_frictio'. Did you mean 'low_friction'?"),
        (("low_friction", "--factor", "7"), "low_friction.factor: 7 is not in 0.01 .. 1"),
        (("tip", "--by", "far"), "expected a number (radians, or degrees as 90deg), got 'far'"),
        (("motor_dead", "--side", "top"), "'top' is not one of 'left', 'right', 'both'"),
        (
            ("low_friction", "--factor", "0.5", "--clear"),
            "--clear ends the fault: leave --factor out",
        ),
        (("low_friction", "--asset", "nobody"), "there is no asset 'nobody'"),
        (("link_lost",), "No such command 'link_lost'"),
    ],
)
def test_what_makes_no_sense_is_refused_with_status_2(texts: tuple[str, ...], text: str) -> None:
    result = rover_inject(*texts)
    assert result.exit_code == 2
    assert text in result.output
