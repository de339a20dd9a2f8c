"""The rover MOCUP behind the port `MotionRover`: what the executive wants, as MOPS commands.

The brick does one thing at a time, so commands wait here until it has answered the one before; a
stop does not wait. What is asked for a command of mission control goes out under that one's source
and number, with a counter, so that `rover-nxt` knows both links' copies of it for one. No ROS and
no clock of its own: messages go out by `send` and come in by `take`.
"""

import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count
from typing import Final, assert_never

from adapters.mops import Dictionary, Message, MopsError, encode, is_last
from executive.clock import Clock
from executive.commands import (
    DriveFor,
    MoveForward,
    Request,
    RotateBy,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetTravelSpeed,
    Stop,
)
from executive.ports import (
    Advance,
    CameraIntent,
    Hold,
    TurnBy,
    WholeMotion,
)
from executive.reports import Identity, Stage
from executive.state import CommandEnded, CommandUnderWay, MotionEnded, Stopped

_LOG: Final = logging.getLogger(__name__)

AGAIN_S: Final = 1.0
"""After this, what nobody has answered is sent again, and angles are asked for again."""
PATIENCE_S: Final = 3.0
"""After this, nobody waits for the answer to what is no motion."""
MOST_ASKED: Final = 64
"""Commands whose answers are remembered."""
Ends = MotionEnded | CommandEnded | CommandUnderWay | Stopped
"""What the plugin tells the executive of."""
_OF_CAMERA: Final = (SetCameraRotateSpeed, SetCameraAngles)


@dataclass(frozen=True, slots=True)
class _Errand:
    request: Request
    command: Identity | None = None
    motion: WholeMotion | None = None


@dataclass(frozen=True, slots=True)
class _Label:
    """What a reply carries back."""

    identity: Identity
    counter: int | None


class MocupRover:
    """Commands one brick.

    Args:
        send: takes each message on its way to the brick.
        observe: gets the end of each whole motion, and what becomes of what came by the other link
            first.
        source: the name under which the brick is told what is of no command.
        dest: the brick's name.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        clock: Clock,
        send: Callable[[Message], None],
        observe: Callable[[Ends], None],
        source: str,
        dest: str,
    ) -> None:
        self._dictionary = dictionary
        self._stop = dictionary.spelling.commands["stop"]
        self._clock = clock
        self._send = send
        self._observe = observe
        self._source = source
        self._dest = dest
        self._numbers = count(round(clock.utc_s() * 1e6))
        self._waiting: deque[_Errand] = deque()
        self._counters = count(1)
        self._asked: dict[_Label, _Errand] = {}
        self._last: _Label | None = None
        self._unheard: Message | None = None
        self._last_at_s = self._sent_at_s = 0.0
        self._speeds: dict[type, Request] = {}
        self._speeds_of: Identity | None = None
        self._camera: CameraIntent | None = None
        self._camera_at_s = 0.0

    def carry_out(self, motion: WholeMotion) -> None:
        """Have a motion carried out, after what waits.

        Its speed is set first, if that is new or was set for another command: the other link may
        have set another one meanwhile.
        """
        if motion.command != self._speeds_of:
            self._speeds.clear()
            self._speeds_of = motion.command
        match motion.what:
            case TurnBy(angle_rad, speed_radps):
                self._set(SetRotateSpeed(speed_radps), motion.command)
                request: Request = RotateBy(angle_rad)
            case Advance(distance_m, speed_mps):
                self._set(SetTravelSpeed(speed_mps), motion.command)
                request = MoveForward(distance_m)
            case Hold(velocity, duration_s):
                request = DriveFor(velocity.travel_mps, velocity.rotate_radps, duration_s)
            case _:
                assert_never(motion.what)
        self._put(_Errand(request, motion.command, motion))

    @property
    def moving(self) -> bool:
        """Whether the brick has a motion of the executive's, or is to have one."""
        errands = (*self._asked.values(), *self._waiting)
        return any(errand.motion is not None for errand in errands)

    def halt(self) -> None:
        """Send a stop at once; what waits is not sent any more."""
        self._waiting.clear()
        self._speeds.clear()
        self._ask(_Errand(Stop()))

    def point_camera(self, wanted: CameraIntent) -> None:
        """Have the camera pointed; the same is asked for again after a while only."""
        now_s = self._clock.now_s()
        if wanted != self._camera:
            self._waiting = deque(e for e in self._waiting if not isinstance(e.request, _OF_CAMERA))
            self._put(_Errand(SetCameraRotateSpeed(wanted.speed_radps), wanted.command))
        elif now_s - self._camera_at_s < AGAIN_S:
            return
        self._camera, self._camera_at_s = wanted, now_s
        self._put(_Errand(SetCameraAngles(wanted.pan_rad, wanted.tilt_rad), wanted.command))

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
        label = _label_of(reply)
        if self._is_anothers_stop(reply):
            self._yield_to(reply)
            return
        if label is None:
            _LOG.debug("no command is answered by %s", reply)
            return
        if label not in self._asked:
            if label.counter is None:
                self._hear_of(label.identity, reply)
            return
        if label == self._last:
            self._unheard = None
        if is_last(reply):
            self._end(label, reply)
            self._next()

    def _yield_to(self, stop: Message) -> None:
        """End what the brick was asked: the other link has stopped it."""
        self._observe(Stopped(f"{stop.dest}:{stop.moe_inputs_id}"))
        errands = (*self._asked.values(), *self._waiting)
        self._asked = {k: e for k, e in self._asked.items() if isinstance(e.request, Stop)}
        self._waiting.clear()
        self._speeds.clear()
        if self._last not in self._asked:
            self._last = self._unheard = None
        for errand in errands:
            self._tell_end(errand, stop)

    def _is_anothers_stop(self, reply: Message) -> bool:
        """Return whether `rover-nxt` says that it passes on a stop of the other link."""
        begun = reply.outputs[:1] == (Stage.STARTED.name,)
        return begun and reply.code == self._stop and reply.dest != self._source

    def _hear_of(self, command: Identity, reply: Message) -> None:
        if is_last(reply):
            self._settle(command, reply)
        else:
            self._observe(CommandUnderWay(command))

    def _settle(self, command: Identity, reply: Message) -> None:
        """End what is asked for a command that the brick has had by the other link."""
        theirs = [errand for errand in self._waiting if errand.command == command]
        self._waiting = deque(e for e in self._waiting if e.command != command)
        for label in [key for key, errand in self._asked.items() if errand.command == command]:
            self._end(label, reply)
        for errand in theirs:
            self._tell_end(errand, reply)
        self._observe(CommandEnded(command, reply.executed, _why(reply)))
        self._next()

    def _end(self, label: _Label, reply: Message) -> None:
        errand = self._asked.pop(label)
        if not reply.executed:
            level = logging.INFO if Stage.CANCELLED.name in reply.outputs[:1] else logging.WARNING
            _LOG.log(level, "%s not executed: %s", reply.command, _why(reply))
            self._speeds.pop(type(errand.request), None)
            self._drop_motion_after(errand, reply)
        self._tell_end(errand, reply)
        if label == self._last:
            self._last = self._unheard = None

    def _drop_motion_after(self, errand: _Errand, reply: Message) -> None:
        """Begin no motion at a speed that the brick did not take."""
        following = self._waiting[0] if self._waiting else None
        if (
            isinstance(errand.request, SetTravelSpeed | SetRotateSpeed)
            and following is not None
            and following.motion is not None
            and following.command == errand.command
        ):
            self._tell_end(self._waiting.popleft(), reply)

    def _tell_end(self, errand: _Errand, reply: Message) -> None:
        if errand.motion is not None:
            self._observe(MotionEnded(errand.motion.number, reply.executed, _why(reply)))

    def _set(self, speed: SetTravelSpeed | SetRotateSpeed, command: Identity) -> None:
        if self._speeds.get(type(speed)) != speed:
            self._speeds[type(speed)] = speed
            self._put(_Errand(speed, command))

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
        command = errand.command
        label = None if command is None else _Label(command, next(self._counters))
        if label is None or not self._can_be_sent(errand.request, label):
            label = _Label(Identity(self._source, next(self._numbers)), None)
        self._last = label
        self._last_at_s = self._sent_at_s = self._clock.now_s()
        self._asked[label] = errand
        if len(self._asked) > MOST_ASKED:
            del self._asked[next(iter(self._asked))]
        self._unheard = self._message(errand.request, label)
        self._send(self._unheard)

    def _can_be_sent(self, request: Request, label: _Label) -> bool:
        """Return whether a command's source can stand in messages; by the relay none else comes."""
        try:
            encode(self._message(request, label))
        except MopsError:
            return False
        return True

    def _message(self, request: Request, label: _Label) -> Message:
        asked = self._dictionary.command(request, label.identity, self._dest)
        return replace(asked, moe_inputs_counter=label.counter)


def _label_of(reply: Message) -> _Label | None:
    if reply.moe_inputs_id is None:
        return None
    return _Label(Identity(reply.dest, reply.moe_inputs_id), reply.moe_inputs_counter)


def _why(reply: Message) -> str:
    return " ".join(part for part in reply.outputs[:3] if part)
