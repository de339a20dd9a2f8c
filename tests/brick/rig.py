"""A brick on a rig: its wheels do what they are told, exactly and at once."""

from dataclasses import dataclass
from math import degrees
from random import Random

import pytest

from adapters.mops.codec import Message, MopsStream, encode
from adapters.mops.dictionary import load_dictionary
from executive.values.geometry import Pose
from executive.values.reports import TERMINAL
from sim.brick.firmware import Firmware
from sim.brick.machine import SensorReadings, SetPoints
from sim.brick.motion import BrickSettings

PERIOD_S = 0.02
DICTIONARY = load_dictionary()
SPELLING = DICTIONARY.spelling
SETTINGS = BrickSettings()
ENDS = {stage.name for stage in TERMINAL}


def command(name: str, number: int, *inputs: str) -> Message:
    entry = DICTIONARY.commands[name]
    return Message(entry.code, "EXEC", "MOCUP", entry.command, inputs, moe_inputs_id=number)


def is_end(reply: Message) -> bool:
    return reply.executed or not reply.received or reply.outputs[0] in ENDS


@dataclass(frozen=True)
class Reply:
    at_s: float
    message: Message


class Rig:
    """Gives a brick octets and time, and keeps what it says.

    Attributes:
        replies, telemetry: what it said, with the time.
        stuck: whether its wheels do not turn.
        points: the newest set points.
    """

    def __init__(self, seed: int = 0) -> None:
        self.brick = Firmware(DICTIONARY, SETTINGS, Pose(), Random(seed))
        self.replies: list[Reply] = []
        self.telemetry: list[Reply] = []
        self.stuck = False
        self.points = SetPoints(0.0, 0.0, 0.0, 0.0)
        self._stream = MopsStream(lambda line: pytest.fail(line))
        self._wheels_rad = [0.0, 0.0]
        self._periods = 0
        self._numbers = 0

    @property
    def time_s(self) -> float:
        return self._periods * PERIOD_S

    @property
    def turning(self) -> bool:
        return (self.points.left_radps, self.points.right_radps) != (0.0, 0.0)

    def send(self, name: str, *inputs: str) -> Message:
        """Give it a command, and return that."""
        self._numbers += 1
        message = command(name, self._numbers, *inputs)
        self.receive(encode(message))
        return message

    def receive(self, octets: bytes) -> None:
        self.brick.receive(octets, self.time_s)

    def run(self, duration_s: float) -> None:
        for _ in range(round(duration_s / PERIOD_S)):
            self.step()

    def step(self) -> None:
        self._periods += 1
        if not self.stuck:
            self._wheels_rad[0] += self.points.left_radps * PERIOD_S
            self._wheels_rad[1] += self.points.right_radps * PERIOD_S
        left, right = (int(degrees(angle_rad) // 1) for angle_rad in self._wheels_rad)
        senses = SensorReadings(left, right, 8.0, self.points.pan_rad, self.points.tilt_rad)
        self.points = self.brick.step(self.time_s, senses, PERIOD_S)
        for message in self._stream.feed(self.brick.transmit()):
            telemetry = message.code == SPELLING.telemetry.code
            (self.telemetry if telemetry else self.replies).append(Reply(self.time_s, message))

    def answers(self, requested: Message) -> list[Reply]:
        """Return the replies to a command."""
        return [
            reply
            for reply in self.replies
            if reply.message.moe_inputs_id == requested.moe_inputs_id
        ]

    def measured(self) -> dict[str, str]:
        """Return the newest telemetry, by parameter."""
        names = [parameter.name for parameter in SPELLING.telemetry.outputs]
        return dict(zip(names, self.telemetry[-1].message.outputs, strict=True))
