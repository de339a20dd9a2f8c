"""`rover command`, as typed, against a rover that answers."""

import json
import re
import signal
import subprocess
import sys
import threading
from math import pi
from subprocess import PIPE
from unittest.mock import AsyncMock

import click
import pytest
from click.shell_completion import BashComplete
from click.testing import CliRunner, Result

from adapters.cli.main import main
from adapters.mrs.cli.command_group import action
from adapters.mrs.cli.sending import CommandSender
from adapters.mrs.ground import MrsClient
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.ground.session import RoverSession
from adapters.mrs.spec import AreaError
from executive.commands import (
    ActivatePlan,
    Command,
    DriveFor,
    ExecuteAction,
    FollowPath,
    Mode,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    OnlyAt,
    Precondition,
    PreemptionPolicy,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    TakePicture,
    Waypoint,
    all_declarations,
    declaration_of,
)
from executive.core.runner import Executive
from executive.settings import Controller, TargetFrame
from tests.mrs.aboard import Aboard, rover
from tests.support.plans import plan

DONE, FAILED, USAGE, UNREACHABLE, INTERRUPTED = 0, 1, 2, 3, 130
ROVER = "from adapters.cli.main import main; main()"
STAMP = r"\d\d:\d\d:\d\d\.\d\d\d"


def command(aboard: Aboard, *arguments: str) -> Result:
    return rover("command", "--to", aboard.uri, *arguments)


@pytest.fixture
def taken(aboard: Aboard, monkeypatch: pytest.MonkeyPatch) -> list[Command]:
    """Give the commands that reach the core."""
    commands: list[Command] = []
    executive = aboard.do(lambda bench: bench.executive)
    submit = executive.submit

    def note(command: Command, reply: object) -> None:
        commands.append(command)
        submit(command, reply)  # type: ignore[arg-type]

    monkeypatch.setattr(executive, "submit", note)
    return commands


@pytest.mark.parametrize(
    ("typed", "request_"),
    [
        ("moveTo 3 2", MoveTo(Waypoint(3.0, 2.0))),
        ("moveTo -1 -.5 --heading -90deg", MoveTo(Waypoint(-1.0, -0.5, -pi / 2))),
        ("moveTo 3 2 --tolerance 0.1", MoveTo(Waypoint(3.0, 2.0, None, 0.1))),
        ("moveTo 3 2 --controller turn_drive", MoveTo(Waypoint(3.0, 2.0), Controller.TURN_DRIVE)),
        ("moveTo 3 2 --frame odom", MoveTo(Waypoint(3.0, 2.0), frame=TargetFrame.ODOM)),
        ("followPath --frame odom 1,0", FollowPath((Waypoint(1.0, 0.0),), frame=TargetFrame.ODOM)),
        ("moveForward 1.5", MoveForward(1.5)),
        ("moveForward -1", MoveForward(-1.0)),
        ("moveForward 50cm", MoveForward(0.5)),
        ("moveForward 1 m --replace", MoveForward(1.0)),
        ("moveForward -0,5", MoveForward(-0.5)),
        ("moveTo 3 2 --tolerance 0,1 --heading 90 deg", MoveTo(Waypoint(3.0, 2.0, pi / 2, 0.1))),
        ("followPath 1m,0 200cm,0", FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0)))),
        ("rotateTo 90deg", RotateTo(pi / 2)),
        ("rotateTo -1.5rad", RotateTo(-1.5)),
        ("rotateBy -90deg", RotateBy(-pi / 2)),
        ("rotateBy 0.5rad", RotateBy(0.5)),
        ("drive -0.2 -0.1rad 3", DriveFor(-0.2, -0.1, 3.0)),
        ("drive 0 45deg 3s", DriveFor(0.0, pi / 4, 3.0)),
        (
            "followPath 1,0 -1,-1,180° 0,1.5",
            FollowPath((Waypoint(1.0, 0.0), Waypoint(-1.0, -1.0, pi), Waypoint(0.0, 1.5))),
        ),
        (
            "followPath 1,0,,0.1 0,1,90deg,0.05",
            FollowPath((Waypoint(1.0, 0.0, None, 0.1), Waypoint(0.0, 1.0, pi / 2, 0.05))),
        ),
        (
            "followPath --controller turn_drive 1,0 2,0",
            FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0)), Controller.TURN_DRIVE),
        ),
        ("stop", Stop()),
        ("setTravelSpeed 0.5", SetTravelSpeed(0.5)),
        ("setRotateSpeed 45deg", SetRotateSpeed(pi / 4)),
        ("setPositionCompensation 1 -2 0 -10deg", SetPositionCompensation(1, -2, 0, -pi / 18)),
        ("setCameraAngles --pan -45deg", SetCameraAngles(-pi / 4, None)),
        ("setCameraAngles --tilt 0.1rad", SetCameraAngles(None, 0.1)),
        ("moveCameraAngles --pan 9deg", MoveCameraAngles(pi / 20, 0.0)),
        ("setCameraRotateSpeed 0.5rad/s", SetCameraRotateSpeed(0.5)),
        ("takePicture", TakePicture()),
        ("setStatusInterval 2", SetStatusInterval(2.0)),
        ("action VIDEO ON", ExecuteAction("VIDEO ON")),
    ],
)
def test_a_typed_command_is_that_received_by_the_core(
    aboard: Aboard, taken: list[Command], typed: str, request_: Request
) -> None:
    result = command(aboard, "--no-wait", *typed.split())
    assert (result.exit_code, result.output.splitlines()[-1]) == (DONE, "acknowledged")
    assert [each.request for each in taken] == [request_]
    replaces = "--replace" in typed
    assert taken[0].preemption is PreemptionPolicy[["APPEND", "REPLACE"][replaces]]


def test_options_go_along(aboard: Aboard, taken: list[Command]) -> None:
    before = ("--source", "MOE-7", "--id", "42", "--lifetime", "1e5d")
    assert command(aboard, *before, "moveForward", "1", "--replace", "--no-wait").exit_code == DONE
    assert str(taken[0].identity) == "MOE-7:42"
    assert taken[0].lifetime_s == 8.64e9
    assert taken[0].preemption is PreemptionPolicy.REPLACE


def test_a_precondition_goes_along(aboard: Aboard, taken: list[Command]) -> None:
    only = ("--only-at", "3,2,50cm,90deg,10deg", "--only-after", "17", "--only-mode", "idle")
    assert command(aboard, *only, "moveForward", "1", "--no-wait").exit_code == FAILED
    at = OnlyAt(3.0, 2.0, 0.5, pi / 2, pi / 18)
    assert [each.precondition for each in taken] == [Precondition(at, 17, Mode.IDLE)]
    assert command(aboard, *only, "stop", "--no-wait").exit_code == DONE
    assert taken[1].precondition is None


@pytest.mark.parametrize(
    ("option", "value", "text"),
    [
        ("--only-at", "3,2", "write X,Y,WITHIN or X,Y,WITHIN,HEADING,WITHIN"),
        ("--only-at", "3,2,1,90,10deg", "90 has no unit: write 90deg or 90rad"),
        ("--only-at", "3,2,0", "a bound is not above zero"),
        ("--only-after", "0", "0 is not in the range"),
        ("--only-mode", "ASLEEP", "'ASLEEP' is not one of"),
    ],
)
def test_a_precondition_that_cannot_be_read_is_not_sent(
    aboard: Aboard, taken: list[Command], option: str, value: str, text: str
) -> None:
    result = command(aboard, option, value, "moveForward", "1")
    assert (result.exit_code, taken) == (2, [])
    assert text in " ".join(result.output.split())


def test_a_rover_that_announces_no_preconditions_gets_none(
    aboard: Aboard, taken: list[Command], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RoverConsumer, "lists", AsyncMock(return_value=False))
    result = command(aboard, "--only-mode", "IDLE", "moveForward", "1")
    assert (result.exit_code, taken) == (FAILED, [])
    assert "does not support preconditions" in result.output
    assert command(aboard, "--only-mode", "IDLE", "stop", "--no-wait").exit_code == DONE


def test_each_operation_is_a_command_of_its_own(
    aboard: Aboard, taken: list[Command], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert rover("moveTo", "3", "2", "--to", aboard.uri, "--no-wait").exit_code == DONE
    monkeypatch.setenv("ROVER_URI", aboard.uri)
    assert rover("stop", "--id", "7", "--no-wait").output.splitlines()[-1] == "acknowledged"
    assert [each.request for each in taken] == [MoveTo(Waypoint(3.0, 2.0)), Stop()]
    assert taken[1].identity.command_id == 7


def test_resume_fits_the_mode(
    aboard: Aboard, taken: list[Command], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROVER_URI", aboard.uri)
    result = rover("resume")
    assert (result.exit_code, taken) == (FAILED, [])
    assert "jackal is IDLE: there is nothing to resume" in result.output
    ahead = plan('<moveForward distance="50" deadline_s="900"/>', "ahead")
    aboard.carry_out(SubmitPlan(ahead), ActivatePlan("ahead"), Stop())
    result = rover("resume")
    assert "jackal is STOPPED: resume releases it" in result.output
    assert "plan ahead is suspended: `rover resume` again resumes it" in result.output
    result = rover("resume")
    assert "jackal is PAUSED: resumes plan ahead" in result.output
    assert [each.request for each in taken][-2:] == [Resume(), ResumePlan("ahead")]
    assert result.exit_code == DONE


def test_prints_the_life_cycle_of_a_command(aboard: Aboard) -> None:
    aboard.runs = True
    result = command(aboard, "moveForward", "0.5")
    assert result.exit_code == DONE
    first, *stages = result.output.splitlines()
    assert re.fullmatch(r"MOE:\d+ moveForward", first)
    names = ["RECEIVED", "ACCEPTED", "STARTED", "PREDICTED", "EXECUTED"]
    for line, name in zip(stages, names, strict=True):
        assert re.match(rf"{STAMP}  {name} ", line)
    assert re.search(
        r"predicted: 1\.5 s, 0\.5 m, 65 J, end \(0\.50, 0\.00, 0°\) ± 0\.02 m$", stages[-2]
    )
    assert re.search(
        r"\[duration 1\.\d\d s \(predicted 1\.45 s\), length 0\.\d\d m \(predicted 0\.50 m\),"
        r" position error 0\.\d\d m, heading error 0\.\d\d°\]$",
        stages[-1],
    )


def test_prints_the_life_cycle_of_a_command_as_json(aboard: Aboard) -> None:
    aboard.runs = True
    result = command(aboard, "--json", "--id", "7", "stop")
    assert result.exit_code == DONE
    sent, *lifecycle = map(json.loads, result.output.splitlines())
    assert sent == {"source": "MOE", "commandId": 7, "command": "stop"}
    assert [each["stage"] for each in lifecycle][-1] == "EXECUTED"
    assert {(each["source"], each["commandId"]) for each in lifecycle} == {("MOE", 7)}


def test_gives_the_reason_of_a_refused_command(aboard: Aboard) -> None:
    result = command(aboard, "moveForward", "1000")
    assert result.exit_code == FAILED
    assert "REJECTED   102 OUT_OF_RANGE: distance 1000 m is above" in result.output
    assert "[" not in result.output, "the text has the figures"
    assert "refused" not in result.output
    result = command(aboard, "drive", "9", "0", "1")
    assert "travel 9 m/s is above its bound of" in result.output


@pytest.mark.parametrize("options", [(), ("--no-wait",)])
def test_a_refusal_is_a_failure_however_it_is_waited_for(
    aboard: Aboard, options: tuple[str, ...]
) -> None:
    assert command(aboard, "stop", "--help").exit_code == DONE
    result = command(aboard, *options, "resume")
    assert result.exit_code == FAILED
    assert "not accepted in mode IDLE" in result.output


def test_reports_a_used_number(aboard: Aboard) -> None:
    assert command(aboard, "--id", "5", "setTravelSpeed", "0.5").exit_code == DONE
    result = command(aboard, "--id", "5", "setTravelSpeed", "0.5")
    assert result.exit_code == FAILED
    assert "EXECUTED" in result.output
    assert "refused: Duplicate: MOE:5 is a repeat and not executed again" in result.output
    result = command(aboard, "--id", "5", "setTravelSpeed", "0.4")
    assert result.exit_code == FAILED
    assert "MOE:5 was accepted before, as this or another command" in result.output
    result = command(aboard, "--id", "5", "--no-wait", "setTravelSpeed", "0.5")
    assert "refused: Duplicate: this source has already used command id 5" in result.output


def typed_in_process(*arguments: str) -> "subprocess.Popen[str]":
    """Start `rover` in a process of its own."""
    program = [sys.executable, "-c", ROVER, *arguments]
    return subprocess.Popen(program, stdout=PIPE, stderr=PIPE, text=True)


def wait_for(process: "subprocess.Popen[str]", word: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if word in line:
            return
    raise AssertionError(f"{word} did not come")


def test_a_motion_that_was_stopped_is_a_failure(aboard: Aboard) -> None:
    aboard.runs = True
    moving = typed_in_process("command", "--to", aboard.uri, "moveForward", "90")
    wait_for(moving, "STARTED")
    assert command(aboard, "--id", "3", "stop").exit_code == DONE
    output, _ = moving.communicate()
    assert moving.returncode == FAILED
    assert "CANCELLED  801 STOPPED: stopped by MOE:3" in output


def test_ctrl_c_leaves_the_command_active_and_reports_it(aboard: Aboard) -> None:
    moving = typed_in_process("command", "--to", aboard.uri, "moveForward", "90")
    wait_for(moving, "STARTED")
    moving.send_signal(signal.SIGINT)
    _, errors = moving.communicate()
    assert moving.returncode == INTERRUPTED
    assert "may continue: `rover stop` ends it" in errors
    assert aboard.do(lambda bench: bench.executive.moving)


def test_a_rover_that_goes_away_cannot_be_reached(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "adapters.mrs.ground.client.RoverSession",
        lambda *maximum: RoverSession(*(*maximum[:-2], 0.1, maximum[-1])),
    )
    executive = aboard.do(lambda bench: bench.executive)
    monkeypatch.setattr(executive, "wake", lambda: threading.Thread(target=aboard.hang_up).start())
    result = command(aboard, "moveForward", "1")
    assert result.exit_code == UNREACHABLE


@pytest.mark.parametrize(
    "typed",
    [
        "--lifetime nan moveForward 1",
        "--source= moveForward 1",
        "fly",
        "moveTo 3",
        "moveTo 3 two",
        "moveTo 3 2 --heading north",
        "moveTo 3 2 --headng 90deg",
        "rotateBy 90grad",
        "followPath",
        "followPath 1",
        "followPath 1,2,3,4,5",
        "followPath 1,2,,far",
        "followPath 1,2,x",
        "--id 0 stop",
        "--id 9223372036854775808 stop",
        "--to http://x stop",
        "stop now",
        "setCameraAngles",
        "moveCameraAngles",
        "takePicture --format BMP",
        "takePicture --quality 101",
    ],
)
def test_what_makes_no_sense_is_not_sent(aboard: Aboard, taken: list[Command], typed: str) -> None:
    result = rover("command", "--to", aboard.uri, *typed.split())
    assert result.exit_code == USAGE
    assert taken == []


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("moveTo 3,2", "'3,2' is one number, 3.2, or two, 3 and 2: write which"),
        ("drive 0,2 0 5", "'0,2' is one number, 0.2, or two, 0 and 2: write which"),
        ("rotateBy 5", "5 has no unit: write 5deg or 5rad"),
        ("setRotateSpeed 5", "5 has no unit: write 5deg/s or 5rad/s"),
        ("moveTo 3 2 --heading 90", "90 has no unit: write 90deg or 90rad"),
        ("moveForward 5miles", "'5miles' is no quantity in m: write 0.5, 0.5m or 50cm"),
        ("stop --asset mocup", "name it by --to HOST:PORT, not by --asset mocup"),
        ("abort", "No such command 'abort'. Use `rover stop`"),
        ("pause", "Use `rover plan suspend`"),
        ("home", "Use `rover moveTo X Y`"),
        ("moveTo 3 2 --headng 90deg", "Did you mean '--heading'?"),
        ("setCameraAngles", "give at least one of --pan, --tilt"),
        ("followPath 1,0,90", "90 has no unit: write 90deg or 90rad"),
        ("moveto 1 1", "Did you mean 'moveTo'?"),
        ("moveTo 1 1 --controller mcp", "'mcp' is not one of 'turn_drive', 'mpc'"),
    ],
)
def test_reports_invalid_options(typed: str, message: str) -> None:
    result = rover("command", *typed.split())
    assert result.exit_code == USAGE
    assert message in " ".join(result.output.split())


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("moveto 1 1", "Did you mean 'moveTo'?"),
        ("comand", "Did you mean 'command'?"),
        ("stpo", "Did you mean 'stop'?"),
        ("abort", "Use `rover stop`"),
    ],
)
def test_an_unknown_command_gets_the_nearest_one(typed: str, message: str) -> None:
    result = rover(*typed.split())
    assert result.exit_code == USAGE
    assert message in result.output


def test_a_target_in_the_map_is_refused_without_its_transform(
    aboard: Aboard, taken: list[Command]
) -> None:
    result = command(aboard, "moveTo", "3", "2", "--frame", "map")
    assert "no transform from map to odom yet" in result.output
    assert taken[0].request == MoveTo(Waypoint(3.0, 2.0), frame=TargetFrame.MAP)


def test_a_controller_that_the_asset_does_not_offer(aboard: Aboard, taken: list[Command]) -> None:
    result = command(aboard, "moveTo", "3", "2", "--controller", "mpc")
    assert result.exit_code == FAILED
    assert taken[0].request == MoveTo(Waypoint(3.0, 2.0), Controller.MPC)
    assert "jackal does not offer it; leave it out, or set mpc.selectable" in result.output


def test_a_picture_is_requested_as_typed(aboard: Aboard, taken: list[Command]) -> None:
    size = "--width 320 --height 200 --format jpg --quality 80"
    assert command(aboard, "takePicture", *size.split()).exit_code == FAILED
    assert taken[0].request == TakePicture(320, 200, "JPG", 80)


def test_actions_are_completed() -> None:
    text = action.params[0]
    with click.Context(action) as ctx:
        assert [each.value for each in text.shell_complete(ctx, "vi")] == ["VIDEO"]
        ctx.params["text"] = ("VIDEO",)
        assert [each.value for each in text.shell_complete(ctx, "")] == ["OFF", "ON"]


def test_plans_files_and_commands_of_the_rover_are_completed(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    def completed(*typed: str) -> list[str]:
        found = BashComplete(main, {}, "rover", "_ROVER_COMPLETE")
        return [each.value for each in found.get_completions(list(typed[:-1]), typed[-1])]

    monkeypatch.setenv("ROVER_URI", aboard.uri)
    aboard.carry_out(SubmitPlan(plan("<takePicture deadline_s='9'/>", "survey")))
    aboard.put("pictures/rock.jpg", b"rock")
    assert command(aboard, "--id", "77", "setTravelSpeed", "0.5").exit_code == DONE
    assert completed("plan", "watch", "su") == ["survey"]
    assert completed("files", "fetch", "pict") == ["pictures/rock.jpg"]
    assert completed("why", "77") == ["77"]
    assert completed("moveTo", "--fr") == ["--frame"]
    aboard.hang_up()
    assert completed("files", "fetch", "pict") == []


@pytest.mark.parametrize("arguments", [("command", "stop"), ("status",)])
def test_a_rover_that_is_not_there(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]
) -> None:
    aboard.hang_up()
    monkeypatch.setenv("ROVER_URI", aboard.uri)
    result = rover(*arguments)
    assert result.exit_code == UNREACHABLE
    assert f"cannot reach the rover: no answer at {aboard.uri}" in result.output
    assert "rover demo --stay" in result.output
    assert "--relay" in result.output


def test_a_name_that_no_computer_has_is_called_so() -> None:
    result = rover("command", "--to", "nowhere.invalid", "stop")
    assert result.exit_code == UNREACHABLE
    assert "unknown host nowhere.invalid: check --to" in result.output
    assert "rover demo" not in result.output


@pytest.mark.parametrize(
    ("name", "typed"),
    [(each.name, typed) for each in all_declarations() for typed in each.examples],
)
def test_the_examples_of_a_declaration_can_be_typed(
    monkeypatch: pytest.MonkeyPatch, name: str, typed: str
) -> None:
    sent: list[Request] = []
    monkeypatch.setattr(CommandSender, "send", lambda _, request, *__: sent.append(request))
    assert rover("command", name, *typed.split()).exit_code == DONE
    assert [declaration_of(type(request)).name for request in sent] == [name]
    assert f"rover command {name} {typed}".strip() in rover("command", name, "--help").output


def test_help_of_an_operation_names_the_options_of_its_group() -> None:
    printed = " ".join(rover("command", "moveForward", "--help").output.split())
    assert "work here, too: --to, --delay" in printed
    assert "--only-at, --only-after, --only-mode" in printed


def test_help_shows_examples() -> None:
    result = rover("command", "--help")
    assert result.exit_code == DONE
    assert "rover command moveTo 3 2 --heading 90deg" in result.output


async def test_text_commands_switch_the_video(aboard: Aboard, client: MrsClient) -> None:
    aboard.runs = True

    actions = {action.name: action.value for action in await client.list_actions()}
    assert list(actions) == ["VIDEO ON", "VIDEO OFF"]
    seen = []
    for name in actions:
        assert (await client.run(client.command(ExecuteAction(name)))).executed
        seen.append((await client.get_camera_state()).videoOn)
    assert seen == [True, False]
    refused = await client.run(client.command(ExecuteAction("VIDEO UP")))
    assert refused.refusal is not None
    assert refused.refusal.number == AreaError.NOT_SUPPORTED.value
    assert "there are: VIDEO ON, VIDEO OFF" in refused.refusal.extra.value


async def test_an_asset_without_video_offers_none(
    monkeypatch: pytest.MonkeyPatch, client: MrsClient
) -> None:
    monkeypatch.setattr(Executive, "video", None)
    assert await client.list_actions() == ()
    assert not (await client.get_camera_state()).videoOn


def test_lists_them_at_the_terminal(aboard: Aboard) -> None:
    result = CliRunner().invoke(main, ["command", "--to", aboard.uri, "action"])
    assert result.exit_code == 0
    assert [line.split("  ")[0] for line in result.output.splitlines()] == ["VIDEO ON", "VIDEO OFF"]


def test_status_shows_whether_video_is_on(aboard: Aboard) -> None:
    def status(*options: str) -> str:
        result = CliRunner().invoke(main, ["status", "--to", aboard.uri, *options])
        assert result.exit_code == 0
        return result.output

    assert "video off" in status()
    aboard.carry_out(ExecuteAction("VIDEO ON"))
    assert "video on" in status()
    assert json.loads(status("--json"))["videoOn"] is True
