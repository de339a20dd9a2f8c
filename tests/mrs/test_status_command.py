"""`rover status` and `rover services`, as typed, against rovers that answer."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.cli.main import main
from adapters.mrs.cli.status_command import late_ticks, slow_disk
from adapters.mrs.spec import ActiveFault, FaultReaction, FaultStatus
from adapters.mrs.spec import types as wire
from executive.commands import ActivatePlan, SetTravelSpeed, Stop, SubmitPlan, SuspendPlan
from executive.values.reasons import Reason
from tests.mrs.aboard import Aboard, rover
from tests.mrs.fleet import Fleet, eventually, value
from tests.mrs.test_command_command import (
    DONE,
    INTERRUPTED,
    ROVER,
    USAGE,
    command,
    typed_in_process,
    wait_for,
)
from tests.support.plans import plan


def test_watches_until_ctrl_c(aboard: Aboard) -> None:
    watching = typed_in_process("status", "--to", aboard.uri, "--watch", "--json")
    wait_for(watching, '"mode": "IDLE"')
    aboard.do(lambda bench: bench.submit(Stop(), 1))
    wait_for(watching, '"mode": "STOPPED"')
    watching.send_signal(signal.SIGINT)
    watching.communicate()
    assert watching.returncode == INTERRUPTED


def test_watches_into_a_file_too(aboard: Aboard) -> None:
    watching = typed_in_process("status", "--to", aboard.uri, "--watch")
    wait_for(watching, "jackal  IDLE")
    aboard.do(lambda bench: bench.submit(Stop(), 1))
    wait_for(watching, "jackal  STOPPED")
    watching.send_signal(signal.SIGINT)
    watching.communicate()
    assert watching.returncode == INTERRUPTED


def test_watches_as_a_table(aboard: Aboard) -> None:
    ours, theirs = pty.openpty()
    program = [sys.executable, "-c", ROVER, "status", "--to", aboard.uri, "--watch"]
    terminal = os.environ | {"TERM": "xterm"}
    with subprocess.Popen(program, stdout=theirs, stderr=theirs, env=terminal) as watching:
        os.close(theirs)
        with open(ours, "rb") as screen:
            shown = b""
            while b"STOPPED" not in shown:
                shown += screen.read1()
                if b"IDLE" in shown:
                    aboard.do(lambda bench: bench.submit(Stop(), 1))
            watching.send_signal(signal.SIGINT)
            with suppress(OSError):
                screen.read()
    assert watching.returncode == INTERRUPTED


def test_a_bad_address_in_the_environment_is_a_usage_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROVER_URI", "http://rover")
    assert rover("status").exit_code == USAGE


def test_shows_the_state_as_a_table(aboard: Aboard) -> None:
    command(aboard, "--no-wait", "--id", "77", "moveForward", "50")
    command(aboard, "--no-wait", "moveForward", "50")
    aboard.run(3.0)
    result = rover("status", "--to", aboard.uri)
    assert result.exit_code == DONE
    first, why, work, *_ = result.output.splitlines()
    assert (first, work) == ("jackal  MOVING", "active command 77, 1 queued")
    assert re.fullmatch(r"moves at \+\d\.\d\d m/s, [+-]0\.0°/s for MOE:77 moveForward", why)
    assert re.search(r"at x [12]\.\d\d m, y 0\.00 m, heading 0\.0°", result.output)
    assert re.search(r"Battery voltage +26\.000 +V +BATERY_VOLTAGE", result.output)
    assert re.search(r"Heading +0\.000 +° +HEAD", result.output)
    assert re.search(r"Maximum angular speed +\d+\.\d{3} +°/s +ROTATE_SPEED", result.output)


def shown(aboard: Aboard) -> list[str]:
    return rover("status", "--to", aboard.uri).output.splitlines()


@pytest.fixture(autouse=True)
def wide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have each line of a status in one line of the terminal."""
    monkeypatch.setenv("COLUMNS", "400")


def test_shows_how_a_stopped_rover_continues(aboard: Aboard) -> None:
    idle = ["jackal  IDLE", "standing: no motion goal", "no command active, queue empty"]
    assert shown(aboard)[:3] == idle
    assert not any("to continue" in line for line in shown(aboard))
    command(aboard, "--no-wait", "stop")
    assert shown(aboard)[1].startswith("standing: stopped by MOE:")
    assert shown(aboard)[3] == "to continue: rover resume"


def test_shows_how_a_rover_in_safe_mode_continues(aboard: Aboard) -> None:
    command(aboard, "--no-wait", "moveForward", "50")
    aboard.run(1.0)
    aboard.do(lambda bench: setattr(bench, "odometry", False))
    aboard.run(1.0)
    lines = shown(aboard)
    assert lines[0] == "jackal  SAFE"
    assert lines[1].startswith("SAFE: odometry is 0.30 s old")
    assert re.fullmatch(r"ALARM odometry_stale since [\d :-]+ UTC, safe until a resume", lines[2])
    assert lines[4] == "to continue, once the cause is cleared: rover resume"
    (fault,) = json.loads(rover("status", "--to", aboard.uri, "--json").output)["faults"]
    assert (fault["name"], fault["reaction"], fault["onResume"]) == ("odometry_stale", "SAFE", True)
    assert fault["parameters"]["age"] > fault["parameters"]["bound"]


def test_shows_that_a_fault_ends_by_itself(aboard: Aboard) -> None:
    aboard.do(lambda bench: setattr(bench, "odometry", False))
    aboard.run(2.0)
    message = (
        r"WARNING odometry_silent since [\d :-]+ UTC, warn while it persists: the newest odometry "
    )
    assert re.match(message, shown(aboard)[2])
    assert not any("to continue" in line for line in shown(aboard))


def test_lists_unmonitored_quantities_in_a_line(aboard: Aboard) -> None:
    (line,) = (each for each in shown(aboard) if each.startswith("not monitored: "))
    assert "slip (no second odometry); the path ahead (no laser)" in line
    reported = json.loads(rover("status", "--to", aboard.uri, "--json").output)["unmonitored"]
    slip = next(each for each in reported if each["quantity"] == "slip")
    assert slip["cause"] == "no second odometry"
    assert "turn_slip" in slip["faults"]


def test_names_the_suspended_plan_and_how_it_continues(aboard: Aboard) -> None:
    ahead = plan('<moveForward distance="50" deadline_s="900"/>', "ahead")
    aboard.carry_out(SubmitPlan(ahead))
    aboard.carry_out(ActivatePlan("ahead"))
    aboard.run(1.0)
    (outcome,) = aboard.carry_out(SuspendPlan("ahead"))
    assert shown(aboard)[0] == "jackal  PAUSED"
    assert shown(aboard)[3:5] == [
        f"plan ahead is suspended: suspended by {outcome.command.identity}",
        "to continue: rover plan resume ahead",
    ]


def test_shows_the_state_as_json(aboard: Aboard) -> None:
    aboard.do(lambda bench: setattr(bench.executive.status, "camera", None))
    result = rover("status", "--to", aboard.uri, "--json")
    state = json.loads(result.output)
    assert (state["asset"], state["mode"]) == ("jackal", "IDLE")
    assert (state["activeCommandId"], state["queuedCommands"]) == (None, 0)
    assert len(state["parameters"]) == 12
    assert state["parameters"]["CAM_PAN"] == {"value": None, "unit": "rad"}
    assert state["parameters"]["BATERY_VOLTAGE"] == {"value": 26.0, "unit": "V"}


def test_lists_the_services_and_their_addresses(aboard: Aboard) -> None:
    result = rover("services", "--to", aboard.uri)
    assert result.exit_code == DONE
    assert re.match(r"jackal  IDLE\n.*Jackal.*\ndomain meteron.jackal, software \d", result.output)
    assert result.output.count(f"\n{aboard.uri}\n") == 1
    assert re.search(r"\n  MotionControl +moveTo, moveForward, ", result.output)
    unfolded = "".join(result.output.split())
    assert f"getArguments;{aboard.uri}InternalBroker" in unfolded


@pytest.fixture
def uri(tmp_path: Path) -> Iterator[str]:
    """Give the address of a rover that heard another."""
    fleet = Fleet(tmp_path)
    jackal = fleet.launch("jackal")
    fleet.launch("scout", above=jackal).carry_out(SetTravelSpeed(0.25))
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    yield jackal.uri
    fleet.close_all()


def status(*arguments: str) -> Result:
    return CliRunner().invoke(main, ("status", *arguments))


def test_lists_the_rovers_and_shows_one(uri: str) -> None:
    listed = status("--to", uri, "--assets")
    assert listed.exit_code == 0, listed.output
    assert [line.split()[:2] for line in listed.output.splitlines() if "IDLE" in line] == [
        ["jackal", "IDLE"],
        ["scout", "IDLE"],
    ]
    assert "Clearpath Jackal" in listed.output
    lines = status("--to", uri, "--assets", "--json").output.splitlines()
    assert [json.loads(line) for line in lines][1] == {"asset": "scout", "mode": "IDLE"}
    shown = status("--to", uri, "--asset", "scout")
    assert shown.exit_code == 0, shown.output
    assert ["TRAVEL_SPEED", "0.250", "m/s"] in [s.split()[:3] for s in shown.output.splitlines()]
    reported = json.loads(status("--to", uri, "--asset", "scout", "--json").output)
    assert reported["asset"] == "scout"
    assert reported["parameters"]["TRAVEL_SPEED"]["value"] == 0.25


def test_names_the_rovers_without_contact(uri: str) -> None:
    result = status("--to", uri, "--asset", "mule")
    assert result.exit_code == USAGE
    assert "mule is unknown" in result.output


@pytest.mark.parametrize(
    "arguments", [("--assets", "--asset", "scout"), ("--assets", "--watch"), ("--asset", "")]
)
def test_options_that_do_not_go_together_are_a_usage_error(
    uri: str, arguments: tuple[str, ...]
) -> None:
    assert status("--to", uri, *arguments).exit_code == USAGE


def test_late_ticks_are_named_as_the_probable_cause_of_faults() -> None:
    fault = ActiveFault(
        name="odometry_late",
        began=0,
        severity=wire.Severity.ALARM,
        reaction=FaultReaction.STOP,
        onResume=True,
        code=912,
        text="odometry arrives late",
    )
    calm, faulty = (
        FaultStatus(timestamp=0, why="idle", active=active, unmonitored=())
        for active in ((), (fault,))
    )
    busy = {"EXEC_TICK_PERIOD": 0.31, "EXEC_OVERRUNS": 796.0}
    (line,) = late_ticks(busy, calm)
    assert "too slow or busy: 796 late ticks" in line
    assert "0.31 s from tick to tick" in line
    quiet_now = {**busy, "EXEC_TICK_PERIOD": 0.06}
    assert late_ticks(quiet_now, calm) == ()
    (line,) = late_ticks(quiet_now, faulty)
    assert "the probable cause of the faults" in line
    assert late_ticks({**quiet_now, "EXEC_OVERRUNS": 3.0}, faulty) == ()
    for reason in (Reason.NAVIGATION_UNCOMMANDED_MOTION, Reason.OTHER_PUBLISHER):
        other = replace(faulty, active=(replace(fault, code=reason.value),))
        assert late_ticks(quiet_now, other) == ()
    assert late_ticks({}, faulty) == ()


def test_a_slow_disk_is_named_with_the_first_wait() -> None:
    (line,) = slow_disk({"EXEC_UNWRITTEN": 12.0, "EXEC_COMMIT_WAIT": 2.31})
    assert line == "the disk aboard is slow: 12 commits wait, the first for 2.3 s"
    assert slow_disk({"EXEC_UNWRITTEN": 1.0, "EXEC_COMMIT_WAIT": 0.02}) == ()
    assert slow_disk({}) == ()
