"""Whether the camera's head is where a command of the relay points it, by the brick's telemetry.

A brick has executed such a command when the head begins to turn. The relay is told EXECUTED once
telemetry shows the angles, and FAILED where it does not in time. What the executive asks for is
answered at once, since it looks at the angles itself.
"""

from dataclasses import dataclass
from math import inf, pi
from typing import Final

from adapters.mops import Dictionary, Message, MopsError, parameters_of
from executive.commands import MoveCameraAngles, SetCameraAngles
from executive.values.clock import Clock
from executive.values.parameters import Parameter

NEAR_RAD: Final = 0.02
"""As `camera.angle_tolerance_rad` of the executive."""
USUAL_RADPS: Final = 0.5
"""How fast the head turns where telemetry does not say so."""
MARGIN_S: Final = 5.0
"""Allowed beside twice the time that the head takes at its speed."""
MOST_AIMED: Final = 64
"""Commands whose angles are remembered."""
_Key = tuple[str, int | None, int | None]
_Angles = tuple[float | None, float | None]
"""Pan and tilt; None for what is not known, or not asked for."""


@dataclass(slots=True)
class _Pointing:
    """Angles that a command asks for, and the reply that waits for them, with its deadline."""

    command: Message
    wanted_rad: _Angles
    reply: Message | None = None
    until_s: float = inf


@dataclass(frozen=True, slots=True)
class PointingResult:
    """How a command for the head ended.

    Attributes:
        reply: of the brick, that it is executed.
        fault: why the head is not there all the same; empty if it is.
    """

    command: Message
    reply: Message
    fault: str = ""


class CameraHeadMonitor:
    """Keeps the brick's replies to commands for the camera's head until it is there.

    Args:
        dictionary: what a message asks for, and how telemetry is spelled.
        clock: of deadlines.
    """

    def __init__(self, dictionary: Dictionary, clock: Clock) -> None:
        self._dictionary = dictionary
        self._clock = clock
        self._seen_rad: _Angles = (None, None)
        self._speed_radps = USUAL_RADPS
        self._pointing: dict[_Key, _Pointing] = {}

    def aim(self, command: Message) -> None:
        """Note a command that goes to the brick now; a relative one counts from where it points."""
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
        if len(self._pointing) > MOST_AIMED:
            del self._pointing[next(iter(self._pointing))]

    def keep(self, command: Message, reply: Message) -> bool:
        """Keep the reply that a command is executed; return False if it is none for the head."""
        pointing = self._pointing.get(_key(command))
        if pointing is None:
            return False
        left_rad = min(_left_rad(pointing.wanted_rad, self._seen_rad), 2 * pi)
        pointing.reply = reply
        pointing.until_s = self._clock.now_s() + 2.0 * left_rad / self._speed_radps + MARGIN_S
        return True

    def keeps(self, command: Message) -> bool:
        """Return whether a reply to a command is kept."""
        pointing = self._pointing.get(_key(command))
        return pointing is not None and pointing.reply is not None

    def forget(self, command: Message) -> None:
        """Forget a command."""
        self._pointing.pop(_key(command), None)

    def clear(self) -> None:
        """Forget all, as the brick is gone."""
        self._pointing.clear()
        self._seen_rad = (None, None)

    def see(self, telemetry: Message) -> list[PointingResult]:
        """Take telemetry, and return the commands whose angles it shows."""
        try:
            told = parameters_of(telemetry, self._dictionary.spelling.telemetry, 0.0)
        except MopsError:
            return []
        known = {each.parameter: each.value for each in told}
        self._seen_rad = known[Parameter.CAM_PAN], known[Parameter.CAM_TILT]
        self._speed_radps = known[Parameter.CAM_ROTATE_SPEED] or USUAL_RADPS
        return [
            PointingResult(each.command, self._taken(each))
            for each in self._waiting()
            if _left_rad(each.wanted_rad, self._seen_rad) <= NEAR_RAD
        ]

    def overdue(self) -> list[PointingResult]:
        """Return the commands whose angles telemetry did not show in time, and what it shows."""
        late = [each for each in self._waiting() if self._clock.now_s() > each.until_s]
        shown = ", ".join("unknown" if seen is None else f"{seen:.3f}" for seen in self._seen_rad)
        text = f"the camera did not reach its angles: it points to {shown} rad"
        return [PointingResult(each.command, self._taken(each), text) for each in late]

    def _waiting(self) -> list[_Pointing]:
        return [each for each in self._pointing.values() if each.reply is not None]

    def _taken(self, pointing: _Pointing) -> Message:
        self.forget(pointing.command)
        assert pointing.reply is not None
        return pointing.reply


def _key(command: Message) -> _Key:
    return command.source, command.moe_inputs_id, command.moe_inputs_counter


def _sum(now_rad: float | None, by_rad: float) -> float | None:
    return None if now_rad is None else now_rad + by_rad


def _left_rad(wanted_rad: _Angles, seen_rad: _Angles) -> float:
    """Return how far the head has to turn yet; infinitely far where it is not known."""
    return max(
        0.0 if wanted is None else inf if seen is None else abs(wanted - seen)
        for wanted, seen in zip(wanted_rad, seen_rad, strict=True)
    )
