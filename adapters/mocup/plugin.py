"""The rover MOCUP behind the port `MotionRover`: what the executive wants, as MOPS commands.

The brick does one thing at a time, so commands wait here until it has answered the one before; a
stop does not wait. No ROS and no clock of its own: messages go out by `send` and come in by `take`.
"""

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from typing import Final, assert_never

from adapters.mops.dictionary import Dictionary
from adapters.mops.message import Message
from executive.commands import (
    DriveFor,
    Identity,
    MoveForward,
    Request,
    RotateBy,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetTravelSpeed,
    Stop,
)
from executive.facts import MotionEnded
from executive.motions import Advance, Hold, TurnBy, WholeMotion
from executive.ports import Clock
from executive.reports import TERMINAL, Stage

_LOG: Final = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""After this, what nobody has answered is sent again, and angles are asked for again."""
PATIENCE_S: Final = 3.0
"""After this, nobody waits for the answer to what is no motion."""
MOST_ASKED: Final = 64
"""Commands whose answers are remembered."""
_ENDS: Final = {stage.name for stage in TERMINAL}


@dataclass(frozen=True, slots=True)
class _Errand:
    request: Request
    motion: WholeMotion | None = None


class MocupRover:
    """Commands one brick.

    Args:
        send: takes each message on its way to the brick.
        observe: gets the end of each whole motion.
        source: the name under which the brick is commanded.
        dest: the brick's name.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        clock: Clock,
        send: Callable[[Message], None],
        observe: Callable[[MotionEnded], None],
        source: str,
        dest: str,
    ) -> None:
        """Have nothing under way."""
        self._dictionary = dictionary
        self._clock = clock
        self._send = send
        self._observe = observe
        self._source = source
        self._dest = dest
        self._numbers = count(round(clock.utc_s() * 1e6))
        self._waiting: deque[_Errand] = deque()
        self._asked: dict[int, _Errand] = {}
        self._last: int | None = None
        self._unheard: Message | None = None
        self._last_at_s = self._sent_at_s = 0.0
        self._speeds: dict[type, Request] = {}
        self._angles: SetCameraAngles | None = None
        self._angles_at_s = 0.0

    def carry_out(self, motion: WholeMotion) -> None:
        """Have a motion carried out, after what waits; its speed is set first if it is new."""
        match motion.what:
            case TurnBy(angle_rad, speed_radps):
                self._set(SetRotateSpeed(speed_radps))
                request: Request = RotateBy(angle_rad)
            case Advance(distance_m, speed_mps):
                self._set(SetTravelSpeed(speed_mps))
                request = MoveForward(distance_m)
            case Hold(velocity, duration_s):
                request = DriveFor(velocity.travel_mps, velocity.rotate_radps, duration_s)
            case _:
                assert_never(motion.what)
        self._put(_Errand(request, motion))

    def halt(self) -> None:
        """Send a stop at once; what waits is not sent any more."""
        self._waiting.clear()
        self._speeds.clear()
        self._ask(_Errand(Stop()))

    def point_camera(self, pan_rad: float, tilt_rad: float) -> None:
        """Have the camera pointed; the same angles are asked for again after a while only."""
        angles, now_s = SetCameraAngles(pan_rad, tilt_rad), self._clock.now_s()
        if angles != self._angles or now_s - self._angles_at_s >= AGAIN_S:
            self._angles, self._angles_at_s = angles, now_s
            waiting = [e for e in self._waiting if not isinstance(e.request, SetCameraAngles)]
            self._waiting = deque(waiting)
            self._put(_Errand(angles))

    def set_camera_speed(self, speed_radps: float) -> None:
        """Have the camera's greatest speed set."""
        self._put(_Errand(SetCameraRotateSpeed(speed_radps)))

    def remind(self) -> None:
        """Send again what nobody has answered for a while, under its number; call now and then.

        A command that is lost before it reaches the adapter of the brick would else never come; the
        adapter gives a brick the same command once.
        """
        if self._unheard is not None and self._clock.now_s() - self._sent_at_s >= AGAIN_S:
            self._sent_at_s = self._clock.now_s()
            self._send(self._unheard)
        self._next()

    def take(self, reply: Message) -> None:
        """Take what the brick answered; what answers nothing is told once and left."""
        number = reply.moe_inputs_id
        errand = None if number is None else self._asked.get(number)
        if reply.dest != self._source or number is None or errand is None:
            _LOG.debug("no command of ours is answered by %s", reply)
            return
        if number == self._last:
            self._unheard = None
        stage, reason, text = (*reply.outputs, "", "", "")[:3]
        if not reply.executed and reply.received and stage not in _ENDS:
            return
        del self._asked[number]
        if not reply.executed:
            level = logging.INFO if stage == Stage.CANCELLED.name else logging.WARNING
            _LOG.log(level, "%s not executed: %s %s %s", reply.command, stage, reason, text)
            self._speeds.pop(type(errand.request), None)
        if errand.motion is not None:
            why = " ".join(part for part in (stage, reason, text) if part)
            self._observe(MotionEnded(errand.motion.number, reply.executed, why))
        if number == self._last:
            self._last = None
            self._next()

    def _set(self, speed: SetTravelSpeed | SetRotateSpeed) -> None:
        if self._speeds.get(type(speed)) != speed:
            self._speeds[type(speed)] = speed
            self._put(_Errand(speed))

    def _put(self, errand: _Errand) -> None:
        self._waiting.append(errand)
        self._next()

    def _next(self) -> None:
        if self._waiting and not self._busy:
            self._ask(self._waiting.popleft())

    @property
    def _busy(self) -> bool:
        """Whether the brick still owes the answer that the next command waits for."""
        errand = None if self._last is None else self._asked.get(self._last)
        if errand is None:
            return False
        return errand.motion is not None or self._clock.now_s() - self._last_at_s < PATIENCE_S

    def _ask(self, errand: _Errand) -> None:
        number = self._last = next(self._numbers)
        self._last_at_s = self._sent_at_s = self._clock.now_s()
        self._asked[number] = errand
        if len(self._asked) > MOST_ASKED:
            del self._asked[min(self._asked)]
        identity = Identity(self._source, number)
        self._unheard = self._dictionary.command(errand.request, identity, self._dest)
        self._send(self._unheard)
