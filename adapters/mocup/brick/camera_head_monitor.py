"""`CameraHeadMonitor`: holds the reply to a camera command until telemetry shows its angles.

The brick replies EXECUTED as soon as the head starts to turn. The relay receives EXECUTED once
telemetry shows the angles, and FAILED if it does not in time. Replies to the executive are
forwarded at once, because the executive monitors the angles itself.
"""

from dataclasses import dataclass
from math import inf, pi
from typing import Final

from adapters.mops import Dictionary, Message, MopsError, parameters_of
from executive.commands import MoveCameraAngles, SetCameraAngles
from executive.values.clock import Clock
from executive.values.parameters import Parameter
from executive.values.quantities import angle_text

ANGLE_TOLERANCE_RAD: Final = 0.02
"""Equal to `camera.angle_tolerance_rad` of the executive."""
USUAL_RADPS: Final = 0.5
"""Rotation speed of the head if telemetry does not give it. Chosen, not measured."""
MARGIN_S: Final = 5.0
"""Allowed in addition to twice the turning time at the head's speed. Chosen, not measured."""
MAX_PENDING: Final = 64
"""Maximum number of commands with pending angles."""
_Key = tuple[str, int | None, int | None]
_Angles = tuple[float | None, float | None]
"""Pan and tilt, rad; None if unknown or not requested."""


@dataclass(slots=True)
class _Pointing:
    """Angles that a command requests, and the reply deferred until then, with its deadline."""

    command: Message
    wanted_rad: _Angles
    reply: Message | None = None
    until_s: float = inf


@dataclass(frozen=True, slots=True)
class PointingResult:
    """Result of a command for the camera head.

    Attributes:
        reply: reply of the brick that it is executed.
        fault: reason why the head is not at its angles; empty if it is.
    """

    command: Message
    reply: Message
    fault: str = ""


class CameraHeadMonitor:
    """Defers the brick's replies to camera commands until the head is at its angles.

    Args:
        dictionary: decodes requests and telemetry.
        clock: clock of the deadlines.
    """

    def __init__(self, dictionary: Dictionary, clock: Clock) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._seen_rad: _Angles = (None, None)
        self._speed_radps = USUAL_RADPS
        self._pointing: dict[_Key, _Pointing] = {}

    def aim(self, command: Message) -> None:
        """Record a command sent to the brick; relative angles start from the current ones."""
        try:
            request = self._dictionary.request(command)
        except MopsError:
            return
        match request:
            case SetCameraAngles(pan_rad, tilt_rad):
                wanted_rad: _Angles = (pan_rad, tilt_rad)
            case MoveCameraAngles(pan_rad, tilt_rad):
                pan_now_rad, tilt_now_rad = self._seen_rad
                wanted_rad = (_sum(pan_now_rad, pan_rad), _sum(tilt_now_rad, tilt_rad))
            case _:
                return
        self._pointing[_key(command)] = _Pointing(command, wanted_rad)
        if len(self._pointing) > MAX_PENDING:
            del self._pointing[next(iter(self._pointing))]

    def defer_reply(self, command: Message, reply: Message) -> bool:
        """Defer the reply that a command is executed; return False if it does not move the head."""
        pointing = self._pointing.get(_key(command))
        if pointing is None:
            return False
        left_rad = min(_left_rad(pointing.wanted_rad, self._seen_rad), 2 * pi)
        pointing.reply = reply
        pointing.until_s = self._clock.now_s() + 2.0 * left_rad / self._speed_radps + MARGIN_S
        return True

    def is_deferred(self, command: Message) -> bool:
        """Return whether the reply to a command is deferred."""
        pointing = self._pointing.get(_key(command))
        return pointing is not None and pointing.reply is not None

    def forget(self, command: Message) -> None:
        """Drop a command."""
        self._pointing.pop(_key(command), None)

    def clear(self) -> None:
        """Drop all commands, as the brick is disconnected."""
        self._pointing.clear()
        self._seen_rad = (None, None)

    def on_telemetry(self, telemetry: Message) -> list[PointingResult]:
        """Process telemetry and return the commands confirmed by its angles."""
        try:
            values = parameters_of(telemetry, self._dictionary.spelling.telemetry, 0.0)
        except MopsError:
            return []
        known = {each.parameter: each.value for each in values}
        self._seen_rad = known[Parameter.CAM_PAN], known[Parameter.CAM_TILT]
        self._speed_radps = known[Parameter.CAM_ROTATE_SPEED] or USUAL_RADPS
        return [
            PointingResult(each.command, self._executed_reply(each))
            for each in self._waiting()
            if _left_rad(each.wanted_rad, self._seen_rad) <= ANGLE_TOLERANCE_RAD
        ]

    def overdue(self) -> list[PointingResult]:
        """Return the commands after their deadline, with the last angles in telemetry."""
        late = [each for each in self._waiting() if self._clock.now_s() > each.until_s]
        shown = ", ".join(
            "unknown" if seen is None else angle_text(seen) for seen in self._seen_rad
        )
        text = f"the camera did not reach its angles in time: it is at {shown}"
        return [PointingResult(each.command, self._executed_reply(each), text) for each in late]

    def _waiting(self) -> list[_Pointing]:
        return [each for each in self._pointing.values() if each.reply is not None]

    def _executed_reply(self, pointing: _Pointing) -> Message:
        self.forget(pointing.command)
        assert pointing.reply is not None
        return pointing.reply


def _key(command: Message) -> _Key:
    return command.source, command.moe_inputs_id, command.moe_inputs_counter


def _sum(now_rad: float | None, by_rad: float) -> float | None:
    return None if now_rad is None else now_rad + by_rad


def _left_rad(wanted_rad: _Angles, seen_rad: _Angles) -> float:
    """Return the remaining angle of the head; infinite if unknown."""
    return max(
        0.0 if wanted is None else inf if seen is None else abs(wanted - seen)
        for wanted, seen in zip(wanted_rad, seen_rad, strict=True)
    )
