"""That the head of the camera was pointed by the relay is told when telemetry shows it."""

import pytest

from adapters.mocup.brick.record import BrickLink
from adapters.mops import Message
from executive.values.parameters import Parameter
from tests.mocup.brick.routing import DICTIONARY, TELEMETRY, Bench, executed, forward, stop


def point(number: int, pan: str, tilt: str, name: str = "setCameraAngles") -> Message:
    entry = DICTIONARY.commands[name]
    inputs = (pan, tilt)
    return Message(entry.code, "MOE", "MOCUP", entry.command, inputs, moe_inputs_id=number)


def telemetry(pan_rad: float, tilt_rad: float, speed_radps: float = 1.0) -> Message:
    known = {
        Parameter.CAM_PAN: pan_rad,
        Parameter.CAM_TILT: tilt_rad,
        Parameter.CAM_ROTATE_SPEED: speed_radps,
    }
    outputs = tuple(str(known.get(name, 0.0)) for name in TELEMETRY.outputs)
    return Message(TELEMETRY.code, "MOCUP", "ALL", TELEMETRY.command, outputs=outputs)


def reported(bench: Bench, link: BrickLink = BrickLink.RELAY) -> list[str]:
    return [message.outputs[0] for by, message in bench.ports.notified if by is link]


@pytest.mark.parametrize(
    ("name", "pan", "tilt", "there_rad"),
    [
        ("setCameraAngles", "0.5", "-0.2", (0.5, -0.2)),
        ("setCameraAngles", "0.5", "", (0.5, 0.3)),
        ("moveCameraAngles", "0.5", "-0.2", (0.6, 0.1)),
    ],
)
def test_the_relay_receives_the_end_once_the_head_is_there(
    bench: Bench, name: str, pan: str, tilt: str, there_rad: tuple[float, float]
) -> None:
    bench.sends(telemetry(0.1, 0.3))
    command = point(7, pan, tilt, name)
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command), telemetry(0.3, 0.3))
    assert reported(bench) == ["STARTED"]
    bench.sends(telemetry(*there_rad))
    assert reported(bench) == ["STARTED", "EXECUTED"]
    bench.sends(telemetry(0.0, 0.0))
    assert reported(bench) == ["STARTED", "EXECUTED"]


def test_a_head_that_does_not_arrive_in_time_fails(bench: Bench) -> None:
    bench.sends(telemetry(0.0, 0.0))
    command = point(7, "1.0", "0.0")
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    bench.clock.advance(6.9)
    bench.router.poll()
    assert reported(bench) == ["STARTED"]
    bench.clock.advance(0.2)
    bench.router.poll()
    (_, ended) = bench.ports.notified[-1]
    assert ended.outputs[:2] == ("FAILED", "PAN_TILT_DEADLINE")
    bench.sends(telemetry(1.0, 0.0))
    assert reported(bench) == ["STARTED", "FAILED"]


def test_what_waits_behind_it_begins_when_it_is_there(bench: Bench) -> None:
    command, after = point(7, "1.0", "0.0"), forward(8)
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    bench.command(BrickLink.RELAY, after)
    assert len(bench.ports.brick) == 1
    bench.sends(telemetry(1.0, 0.0))
    assert len(bench.ports.brick) == 2


def test_the_executive_is_answered_at_once_and_checks_itself(bench: Bench) -> None:
    command = point(7, "1.0", "0.0")
    bench.command(BrickLink.DIRECT, command)
    bench.sends(executed(command))
    assert reported(bench, BrickLink.DIRECT) == ["EXECUTED"]


def test_a_stop_neither_ends_it_nor_does_a_silent_relay_stop_the_brick_for_it(bench: Bench) -> None:
    command = point(7, "1.0", "0.0")
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    bench.router.on_host_silent(BrickLink.RELAY)
    assert bench.router.counts.dead_man == 0
    bench.command(BrickLink.RELAY, stop(8))
    bench.sends(executed(stop(8)))
    for _ in range(3):
        bench.router.poll()
    bench.sends(telemetry(1.0, 0.0))
    assert reported(bench) == ["STARTED", "EXECUTED", "EXECUTED"]


def test_a_brick_that_disconnects_during_the_motion_fails_it(bench: Bench) -> None:
    command = point(7, "1.0", "0.0")
    bench.command(BrickLink.RELAY, command)
    bench.sends(executed(command))
    bench.router.on_disconnected()
    assert reported(bench) == ["STARTED", "FAILED"]
    bench.router.on_connected(2)
    bench.sends(telemetry(1.0, 0.0))
    assert reported(bench) == ["STARTED", "FAILED"]
    assert bench.router.counts.dead_man == 0
