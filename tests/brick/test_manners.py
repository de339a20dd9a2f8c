"""The manners of the emulated brick: what it answers, and when."""

from itertools import pairwise

import pytest

from adapters.mops.codec import encode
from tests.brick.rig import Reply, Rig, command


def stages(replies: list[Reply]) -> list[tuple[str, bool, bool]]:
    return [
        (reply.message.outputs[0], reply.message.received, reply.message.executed)
        for reply in replies
    ]


def test_a_motion_is_received_after_a_while_and_executed_at_standstill() -> None:
    rig = Rig()
    requested = rig.send("moveForward", "0.2")
    rig.run(5.0)
    started, executed = rig.answers(requested)
    assert stages([started, executed]) == [("STARTED", True, False), ("EXECUTED", True, True)]
    assert 0.05 <= started.at_s <= 0.12
    assert executed.at_s == pytest.approx(started.at_s + 0.2 / 0.1 + 0.4, abs=0.3)
    reply = executed.message
    assert (reply.source, reply.dest, reply.inputs) == ("MOCUP", "EXEC", ())
    assert (reply.code, reply.command) == (requested.code, requested.command)
    assert not rig.turning


@pytest.mark.parametrize("delay_s", [0.02, 1.0])
def test_a_stop_acts_at_once_and_ends_the_active_motion(delay_s: float) -> None:
    rig = Rig()
    moving = rig.send("moveForward", "5.0")
    rig.run(delay_s)
    stop = rig.send("stop")
    reported_s = rig.time_s
    rig.step()
    assert not rig.turning
    ended = rig.answers(moving)[-1]
    assert ended.message.outputs == ("CANCELLED", "STOPPED", "stopped")
    assert (ended.message.received, ended.message.executed) == (True, False)
    rig.run(1.0)
    (answer,) = rig.answers(stop)
    assert stages([answer]) == [("EXECUTED", True, True)]
    assert answer.at_s - reported_s <= 0.2
    again = rig.send("moveForward", "0.1")
    rig.run(5.0)
    assert stages(rig.answers(again))[-1] == ("EXECUTED", True, True)


@pytest.mark.parametrize(
    ("name", "inputs", "reason"),
    [
        ("takePicture", ("", "", "", ""), "NOT_SUPPORTED"),
        ("followPath", ("1.0", "0.0", "", ""), "NOT_SUPPORTED"),
        ("moveForward", ("far",), "NOT_SUPPORTED"),
        ("moveForward", ("1e9",), "OUT_OF_RANGE"),
        ("setTravelSpeed", ("5.0",), "OUT_OF_RANGE"),
        ("drive", ("0.1", "9.0", "1.0"), "OUT_OF_RANGE"),
        ("setCameraAngles", ("3.5", ""), "OUT_OF_RANGE"),
        ("setCameraAngles", ("", "-1.5"), "OUT_OF_RANGE"),
    ],
)
def test_an_unsupported_command_is_refused_in_its_reply(
    name: str, inputs: tuple[str, ...], reason: str
) -> None:
    rig = Rig()
    requested = rig.send(name, *inputs)
    rig.run(1.0)
    (answer,) = rig.answers(requested)
    assert answer.message.outputs[:2] == ("REJECTED", reason)
    assert (answer.message.received, answer.message.executed) == (False, False)
    assert not rig.turning


def test_settings_and_angles_take_one_reply_and_show_in_telemetry() -> None:
    rig = Rig()
    for name, inputs in (
        ("setTravelSpeed", ("0.25",)),
        ("setRotateSpeed", ("1.5",)),
        ("setCameraRotateSpeed", ("0.8",)),
        ("setCameraAngles", ("0.5", "")),
        ("setCameraAngles", ("", "0.3")),
    ):
        requested = rig.send(name, *inputs)
        rig.run(1.0)
        assert stages(rig.answers(requested)) == [("EXECUTED", True, True)]
    moved = rig.send("moveCameraAngles", "-0.2", "0.1")
    rig.run(2.0)
    assert stages(rig.answers(moved)) == [("EXECUTED", True, True)]
    measured = {name: float(text) for name, text in rig.measured().items() if text}
    assert measured["TRAVEL_SPEED"] == 0.25
    assert measured["ROTATE_SPEED"] == 1.5
    assert measured["CAM_ROTATE_SPEED"] == 0.8
    assert (measured["CAM_PAN"], measured["CAM_TILT"]) == pytest.approx((0.3, 0.4), abs=0.001)
    assert measured["BATERY_VOLTAGE"] == 8.0
    assert "POS_Z" not in measured


def test_telemetry_arrives_five_times_a_second_also_during_a_motion() -> None:
    rig = Rig()
    rig.send("moveForward", "5.0")
    rig.run(4.0)
    times = [reply.at_s for reply in rig.telemetry]
    assert {round(after - before, 6) for before, after in pairwise(times)} == {0.2}
    assert float(rig.measured()["CURRENT_TRAVEL_SPEED"]) == pytest.approx(0.1, abs=0.01)


def test_a_wheel_that_is_stuck_ends_the_motion() -> None:
    rig = Rig()
    rig.stuck = True
    requested = rig.send("moveForward", "1.0")
    rig.run(2.0)
    outputs = rig.answers(requested)[-1].message.outputs
    assert outputs == ("FAILED", "MOTION_NOT_EXECUTED", "the left motor is stuck")
    assert not rig.turning


def test_messages_for_other_receivers_are_not_answered() -> None:
    rig = Rig()
    rig.receive(encode(command("moveForward", 1, "1.0")).replace(b"MOCUP", b"OTHER"))
    rig.receive(encode(command("moveForward", 1, "1.0")).replace(b"False|False", b"True|True"))
    rig.receive(b"\0\0nonsense#")
    rig.run(1.0)
    assert rig.replies == []
    assert rig.brick.ignored == 3
    assert not rig.turning


@pytest.mark.parametrize(
    ("name", "inputs", "pose"),
    [
        ("moveForward", ("-0.5",), (-0.5, 0.0, 0.0)),
        ("rotateBy", ("-2.0",), (0.0, 0.0, -2.0)),
        ("rotateTo", ("3.0",), (0.0, 0.0, 3.0)),
        ("moveTo", ("0.3", "0.4", "", ""), (0.3, 0.4, 0.927)),
        ("moveTo", ("0.0", "-0.5", "1.0", ""), (0.0, -0.5, 1.0)),
        ("moveTo", ("0.0", "0.0", "1.0", ""), (0.0, 0.0, 1.0)),
        ("drive", ("0.2", "0.0", "3.0"), (0.5, 0.0, 0.0)),
    ],
)
def test_motions_end_at_the_target_of_its_own_odometry(
    name: str, inputs: tuple[str, ...], pose: tuple[float, float, float]
) -> None:
    rig = Rig()
    requested = rig.send(name, *inputs)
    rig.run(20.0)
    assert stages(rig.answers(requested))[-1] == ("EXECUTED", True, True)
    measured = rig.measured()
    reached = tuple(float(measured[name]) for name in ("POS_X", "POS_Y", "HEAD"))
    assert reached == pytest.approx(pose, abs=0.015)
