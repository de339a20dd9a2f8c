"""`Firmware`, the emulated brick's program: octets and measurements in, octets and set points out.

A deterministic state machine without clock, socket or physics. It executes one command at a time;
only a stop interrupts it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from random import Random
from typing import Final, get_args

from adapters.mops import TO_ALL, Dictionary, Message, MopsError, MopsStream, encode
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Stage
from sim.brick.machine import Machine, SensorReadings, SetPoints, Work
from sim.brick.motion import BrickSettings, StuckError

_WORK: Final = get_args(Work)

Readings = Mapping[Parameter, float]
"""Values of telemetry; a missing parameter is sent as unknown."""


@dataclass(slots=True)
class _Task:
    command: Message
    work: Work
    due_s: float
    begun: bool = False


class Firmware:
    """One brick.

    Args:
        random: source of latencies and of the error of its track.

    Attributes:
        machine: its wheels and its camera head.
        distort: changes telemetry before it is sent; None suppresses it.
        mute: whether its output is lost.
        ignored: number of messages that were no commands for it, and of invalid pieces.
    """

    def __init__(
        self, dictionary: Dictionary, settings: BrickSettings, start: Pose, random: Random
    ) -> None:
        self._dictionary = dictionary
        self._settings = settings
        self._random = random
        error = random.uniform(*settings.track_error)
        track_m = settings.track_m * (1 + random.choice((-error, error)))
        self.machine = Machine(settings, track_m, start)
        self.distort: Callable[[Readings], Readings | None] = lambda readings: readings
        self.mute = False
        self.ignored = 0
        self._input_stream = MopsStream(self._ignore)
        self._to_send = bytearray()
        self._task: _Task | None = None
        self._stops: list[Message] = []
        self._last_received_s = 0.0
        self._silence_s = inf
        self._telemetry_number = 1

    def receive(self, octets: bytes, now_s: float) -> None:
        """Process octets, split at any position."""
        self._last_received_s = now_s
        for message in self._input_stream.feed(octets):
            self._process_message(message, now_s)

    def transmit(self) -> bytes:
        """Return the output since the last call."""
        octets = b"" if self.mute else bytes(self._to_send)
        self._to_send.clear()
        return octets

    def step(self, now_s: float, senses: SensorReadings, period_s: float) -> SetPoints:
        """Advance by a period: take measurements, continue the task, emit replies and telemetry."""
        machine = self.machine
        machine.sense(now_s, senses)
        if self._task is not None and now_s - self._last_received_s > self._silence_s:
            machine.brake()
            text = f"no message of the host for {self._silence_s:g} s"
            self._end(Stage.CANCELLED, Reason.INTERRUPTED, text)
        task = self._task
        if task is not None and not task.begun and now_s >= task.due_s:
            task.begun = True
            machine.begin(task.work)
            if machine.moving:
                self._reply(task.command, Stage.STARTED)
        points = self._continue(period_s)
        if task is not None and task.begun and task is self._task and not machine.moving:
            self._end(Stage.EXECUTED)
        if self._stops and machine.odometry.standing:
            self._measure()
            for stop in self._stops:
                self._reply(stop, Stage.EXECUTED)
            self._stops.clear()
        if now_s > self._telemetry_number * self._settings.telemetry_s - period_s / 2:
            self._telemetry_number += 1
            self._measure()
        return points

    def _continue(self, period_s: float) -> SetPoints:
        try:
            return self.machine.set_points(period_s)
        except StuckError as error:
            self._end(Stage.FAILED, Reason.MOTION_NOT_EXECUTED, str(error))
            return self.machine.set_points(period_s)

    def _process_message(self, message: Message, now_s: float) -> None:
        if message.dest != self._settings.name or message.received or message.executed:
            self._ignore(str(message))
            return
        spelling = self._dictionary.spelling
        if message.code == spelling.commands["stop"]:
            self.machine.brake()
            self._end(Stage.CANCELLED, Reason.STOPPED, "stopped")
            self._stops.append(message)
            return
        if message.code == spelling.keep_alive.code:
            self._keep_alive(message)
            return
        try:
            request = self._dictionary.request(message)
        except MopsError as error:
            self._refuse(message, Reason.NOT_SUPPORTED, str(error))
            return
        if not isinstance(request, _WORK):
            self._refuse(message, Reason.NOT_SUPPORTED, "this brick cannot do that")
        elif self._task is not None or self._stops:
            doing = self._stops[0] if self._task is None else self._task.command
            self._refuse(message, Reason.QUEUE_FULL, f"BUSY: {doing.command} is under way")
        elif text := self.machine.refusal(request):
            self._refuse(message, Reason.OUT_OF_RANGE, text)
        else:
            due_s = now_s + self._random.uniform(*self._settings.latency_s)
            self._task = _Task(message, request, due_s)

    def _keep_alive(self, message: Message) -> None:
        """Enable the host timeout: stop after a silence as long as the message gives."""
        try:
            (silence_s,) = map(float, message.inputs)
        except ValueError:
            self._ignore(str(message))
            return
        if 0.0 < silence_s < inf:
            self._silence_s = silence_s * self._settings.host_rate

    def _end(self, stage: Stage, reason: Reason | None = None, text: str = "") -> None:
        """End the task, if there is one; telemetry with its final pose is sent first."""
        task, self._task = self._task, None
        if task is None:
            return
        self._measure()
        self._reply(task.command, stage, reason, text)

    def _refuse(self, command: Message, reason: Reason, text: str) -> None:
        self._reply(command, Stage.REJECTED, reason, text)

    def _reply(
        self, command: Message, stage: Stage, reason: Reason | None = None, text: str = ""
    ) -> None:
        why = "" if reason is None else reason.name
        reply = replace(
            command,
            source=command.dest,
            dest=command.source,
            inputs=(),
            outputs=(stage.name, why, text.replace(",", ";")),
            received=stage is not Stage.REJECTED,
            executed=stage is Stage.EXECUTED,
        )
        self._to_send += encode(reply)

    def _measure(self) -> None:
        """Send telemetry with pose and speed."""
        spelling, machine = self._dictionary.spelling.telemetry, self.machine
        pose, velocity, senses = machine.odometry.pose, machine.odometry.velocity, machine.senses
        measured = {
            Parameter.POS_X: pose.x_m,
            Parameter.POS_Y: pose.y_m,
            Parameter.HEAD: pose.heading_rad,
            Parameter.TRAVEL_SPEED: machine.travel_mps,
            Parameter.ROTATE_SPEED: machine.rotate_radps,
            Parameter.CURRENT_TRAVEL_SPEED: velocity.travel_mps,
            Parameter.CURRENT_ROTATE_SPEED: velocity.rotate_radps,
            Parameter.BATERY_VOLTAGE: senses.voltage_v,
            Parameter.CAM_PAN: senses.pan_rad,
            Parameter.CAM_TILT: senses.tilt_rad,
            Parameter.CAM_ROTATE_SPEED: machine.camera_radps,
        }
        known = self.distort(measured)
        if known is None:
            return
        outputs: Sequence[str] = [
            f"{known[name]:.4f}" if name in known else "" for name in spelling.outputs
        ]
        message = Message(
            spelling.code, self._settings.name, TO_ALL, spelling.command, outputs=tuple(outputs)
        )
        self._to_send += encode(message)

    def _ignore(self, _: str) -> None:
        self.ignored += 1
