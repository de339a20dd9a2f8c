"""The rover MOCUP behind the port `MotionRover`: what the executive wants, as MOPS commands.

The brick does one thing at a time, so commands wait here until it has answered the one before; a
stop does not wait. What is asked for a command of mission control goes out under that one's source
and number, with a counter, so that `rover-nxt` knows both links' copies of it for one. No ROS and
no clock of its own: messages go out by `send` and come in by `take`.
"""

import logging
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Final, assert_never

from adapters.mops import (
    Dictionary,
    Message,
    MopsError,
    RelayAuthority,
    authority_message,
    authority_of,
    encode,
    fingerprint,
    is_last,
    reply_of,
)
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
from executive.record import Grant
from executive.settings import AuthoritySettings
from executive.values.clock import Clock
from executive.values.facts import (
    AuthorityUsed,
    CommandEnded,
    CommandUnderWay,
    MotionEnded,
    MotionStarted,
    Stopped,
)
from executive.values.parameters import ParameterValue
from executive.values.ports import Advance, CameraIntent, Hold, TurnBy, WholeMotion
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, Stage

_LOG: Final = logging.getLogger(__name__)

RETRANSMIT_S: Final = 1.0
"""After this an unanswered command is sent again, and camera angles are sent again."""
ANSWER_TIMEOUT_S: Final = 3.0
"""After this the answer to a command that is no motion is waited for no longer."""
MOST_ASKED: Final = 64
"""Commands whose answers are remembered."""
MOST_UNCONFIRMED: Final = 200
"""Commands whose last report is published until `rover-nxt` confirms it."""
MocupFact = MotionStarted | MotionEnded | CommandEnded | CommandUnderWay | Stopped | AuthorityUsed
"""Facts that the plugin reports to the executive."""
_OF_CAMERA: Final = (SetCameraRotateSpeed, SetCameraAngles)
_TOLD: Final = frozenset(Stage) - {Stage.RECEIVED, Stage.REJECTED, Stage.PROGRESS}


@dataclass(frozen=True, slots=True)
class _BrickRequest:
    request: Request
    command: Identity | None = None
    motion: WholeMotion | None = None


@dataclass(frozen=True, slots=True)
class _ReplyKey:
    """Source, number and counter of a command, which its replies carry."""

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
        observe: Callable[[MocupFact], None],
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
        self._waiting: deque[_BrickRequest] = deque()
        self._counters = count(1)
        self._asked: dict[_ReplyKey, _BrickRequest] = {}
        self._last: _ReplyKey | None = None
        self._unanswered: Message | None = None
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
        self._put(_BrickRequest(request, motion.command, motion))

    @property
    def moving(self) -> bool:
        """Whether the brick has a motion of the executive's, or is to have one."""
        requests = (*self._asked.values(), *self._waiting)
        return any(asked.motion is not None for asked in requests)

    def halt(self) -> None:
        """Send a stop at once; what waits is not sent any more."""
        self._waiting.clear()
        self._speeds.clear()
        self._ask(_BrickRequest(Stop()))

    def emergency_stop(self) -> None:
        """Send a stop at once, from any thread; nothing here is changed by it."""
        key = _ReplyKey(Identity(self._source, next(self._numbers)), None)
        self._send(self._message(Stop(), key))

    def point_camera(self, wanted: CameraIntent) -> None:
        """Have the camera pointed; the same angles are sent again only after `RETRANSMIT_S`."""
        now_s = self._clock.now_s()
        if wanted != self._camera:
            self._waiting = deque(e for e in self._waiting if not isinstance(e.request, _OF_CAMERA))
            self._put(_BrickRequest(SetCameraRotateSpeed(wanted.speed_radps), wanted.command))
        elif now_s - self._camera_at_s < RETRANSMIT_S:
            return
        self._camera, self._camera_at_s = wanted, now_s
        self._put(_BrickRequest(SetCameraAngles(wanted.pan_rad, wanted.tilt_rad), wanted.command))

    def remind(self) -> None:
        """Retransmit an unanswered command under its number; call regularly.

        A command that is lost before it reaches the adapter of the brick would else never come; the
        adapter gives a brick the same command once.
        """
        if self._unanswered is not None and self._clock.now_s() - self._sent_at_s >= RETRANSMIT_S:
            self._sent_at_s = self._clock.now_s()
            self._send(self._unanswered)
        self._next()

    def take(self, reply: Message) -> None:
        """Take a reply of the brick; one that answers nothing is ignored.

        Raises:
            MopsError: it tells of an authority, and of none that there is.
        """
        if reply.code == self._dictionary.spelling.authority.code:
            epoch = authority_of(reply).epoch
            if epoch is not None:
                self._observe(AuthorityUsed(epoch))
            return
        key = _key_of(reply)
        if self._is_anothers_stop(reply):
            self._on_external_stop(reply)
            return
        if key is None:
            _LOG.debug("no command is answered by %s", reply)
            return
        if key not in self._asked:
            if key.counter is None:
                self._hear_of(key.identity, reply)
            return
        if key == self._last:
            self._unanswered = None
        if is_last(reply):
            self._end(key, reply)
            self._next()
        elif reply.outputs[:1] == (Stage.STARTED.name,):
            motion = self._asked[key].motion
            if motion is not None:
                self._observe(MotionStarted(motion.number))

    def _on_external_stop(self, stop: Message) -> None:
        """End what the brick was asked, as the other link has stopped it."""
        self._observe(Stopped(f"{stop.dest}:{stop.moe_inputs_id}"))
        requests = (*self._asked.values(), *self._waiting)
        self._asked = {k: e for k, e in self._asked.items() if isinstance(e.request, Stop)}
        self._waiting.clear()
        self._speeds.clear()
        if self._last not in self._asked:
            self._last = self._unanswered = None
        for asked in requests:
            self._tell_end(asked, stop)

    def _is_anothers_stop(self, reply: Message) -> bool:
        """Return whether `rover-nxt` notifies of a stop of the other link."""
        begun = reply.outputs[:1] == (Stage.STARTED.name,)
        return begun and reply.code == self._stop and reply.dest != self._source

    def _hear_of(self, command: Identity, reply: Message) -> None:
        if is_last(reply):
            self._on_external_result(command, reply)
        else:
            self._observe(CommandUnderWay(command))

    def _on_external_result(self, command: Identity, reply: Message) -> None:
        """End what is asked for a command that the brick has had by the other link."""
        theirs = [asked for asked in self._waiting if asked.command == command]
        self._waiting = deque(e for e in self._waiting if e.command != command)
        for key in [key for key, asked in self._asked.items() if asked.command == command]:
            self._end(key, reply)
        for asked in theirs:
            self._tell_end(asked, reply)
        self._observe(CommandEnded(command, reply.executed, _why(reply)))
        self._next()

    def _end(self, key: _ReplyKey, reply: Message) -> None:
        asked = self._asked.pop(key)
        if not reply.executed:
            level = logging.INFO if Stage.CANCELLED.name in reply.outputs[:1] else logging.WARNING
            _LOG.log(level, "%s not executed: %s", reply.command, _why(reply))
            self._speeds.pop(type(asked.request), None)
            self._drop_motion_after(asked, reply)
        self._tell_end(asked, reply)
        if key == self._last:
            self._last = self._unanswered = None

    def _drop_motion_after(self, asked: _BrickRequest, reply: Message) -> None:
        """Drop the motion that waits for a speed which the brick refused."""
        following = self._waiting[0] if self._waiting else None
        if (
            isinstance(asked.request, SetTravelSpeed | SetRotateSpeed)
            and following is not None
            and following.motion is not None
            and following.command == asked.command
        ):
            self._tell_end(self._waiting.popleft(), reply)

    def _tell_end(self, asked: _BrickRequest, reply: Message) -> None:
        if asked.motion is not None:
            self._observe(MotionEnded(asked.motion.number, reply.executed, _why(reply)))

    def _set(self, speed: SetTravelSpeed | SetRotateSpeed, command: Identity) -> None:
        if self._speeds.get(type(speed)) != speed:
            self._speeds[type(speed)] = speed
            self._put(_BrickRequest(speed, command))

    def _put(self, asked: _BrickRequest) -> None:
        self._waiting.append(asked)
        self._next()

    def _next(self) -> None:
        if self._waiting and not self._busy:
            self._ask(self._waiting.popleft())

    @property
    def _busy(self) -> bool:
        """Whether the brick still owes the answer that the next command waits for."""
        asked = None if self._last is None else self._asked.get(self._last)
        if asked is None:
            return False
        return asked.motion is not None or self._clock.now_s() - self._last_at_s < ANSWER_TIMEOUT_S

    def _ask(self, asked: _BrickRequest) -> None:
        command = asked.command
        key = None if command is None else _ReplyKey(command, next(self._counters))
        if key is None or not self._can_be_sent(asked.request, key):
            key = _ReplyKey(Identity(self._source, next(self._numbers)), None)
        self._last = key
        self._last_at_s = self._sent_at_s = self._clock.now_s()
        self._asked[key] = asked
        if len(self._asked) > MOST_ASKED:
            del self._asked[next(iter(self._asked))]
        self._unanswered = self._message(asked.request, key)
        self._send(self._unanswered)

    def _can_be_sent(self, request: Request, key: _ReplyKey) -> bool:
        """Return whether a command's source can stand in messages; a relayed one always can."""
        try:
            encode(self._message(request, key))
        except MopsError:
            return False
        return True

    def _message(self, request: Request, key: _ReplyKey) -> Message:
        asked = self._dictionary.command(request, key.identity, self._dest)
        return replace(asked, moe_inputs_counter=key.counter)


def _key_of(reply: Message) -> _ReplyKey | None:
    if reply.moe_inputs_id is None:
        return None
    return _ReplyKey(Identity(reply.dest, reply.moe_inputs_id), reply.moe_inputs_counter)


def _why(reply: Message) -> str:
    return " ".join(part for part in reply.outputs[:3] if part)


def relay_authority(settings: AuthoritySettings, grant: Grant) -> RelayAuthority:
    """Return which commands of the relay have the authority, where this was granted last."""
    if grant.holder != settings.relay:
        return RelayAuthority(bool(settings.needed), grant.holder)
    return RelayAuthority(bool(settings.needed), grant.holder, grant.epoch, grant.given_by)


class ClaimAnnouncer:
    """Tells `rover-nxt`, as a downlink, what the executive carries out, and who may command.

    `rover-nxt` stands where both links meet (thesis 6.2). It has to know the commands that come to
    the brick in parts, or not yet, or not at all, to know the relay's copy of one; and what is
    reported on them, to tell the relay. A claim is the command as a MOPS message with RECEIVED set,
    a report a reply. Both go in one string, so that of several only the last has to arrive: it is
    published again until `rover-nxt` confirms it.

    What the executive refused is not claimed: there is nothing that could be done twice. Nor is
    what no message can ask for.

    The authority is told when it has passed on, before anything that its new holder commands.

    Args:
        request_of: returns what a command asked for, if it is known.
        authority: returns which commands of the relay have the authority.
        publish: takes each string on its way.
        source: the name under which the authority is told.
        brick: name of the brick, and of who reports.
    """

    def __init__(
        self,
        dictionary: Dictionary,
        request_of: Callable[[Identity], Request | None],
        authority: Callable[[], RelayAuthority],
        publish: Callable[[str], None],
        source: str,
        brick: str,
    ) -> None:
        self._dictionary = dictionary
        self._request_of = request_of
        self._authority = authority
        self._told_authority: RelayAuthority | None = None
        self._publish = publish
        self._source = source
        self._brick = brick
        self._unconfirmed: dict[Identity | None, str] = {}
        """The last string on each command, and on the authority."""
        self._before: dict[Identity | None, str] = {}

    def report(self, reports: Sequence[Report]) -> None:
        """Publish new reports on commands, and the authority where it has passed on."""
        for report in reports:
            if report.identity is None:
                self._tell_authority()
            else:
                self._tell(report, report.identity)

    def again(self, reports: Iterable[Report]) -> None:
        """Publish the authority, and the last of reports on each command, for a new listener."""
        self._told_authority = None
        self._tell_authority()
        last = {each.identity: each for each in reports if each.stage in _TOLD}
        for identity, report in last.items():
            if identity is not None:
                self._tell(report, identity)

    def taken(self, mark: int) -> None:
        """Note that `rover-nxt` has recorded the string with a fingerprint."""
        for key, text in self._unconfirmed.items():
            if fingerprint(text) == mark:
                del self._unconfirmed[key]
                return

    def look(self) -> None:
        """Publish again what was not confirmed at the last call either."""
        for key, text in self._unconfirmed.items():
            if self._before.get(key) == text:
                self._publish(text)
        self._before = dict(self._unconfirmed)

    def _tell_authority(self) -> None:
        authority = self._authority()
        if authority != self._told_authority:
            self._told_authority = authority
            entry = self._dictionary.spelling.authority
            self._send(None, authority_message(authority, entry, self._source, self._brick))

    def _tell(self, report: Report, identity: Identity) -> None:
        if report.stage not in _TOLD:
            return
        request = self._request_of(identity)
        if request is None:
            return
        try:
            command = self._dictionary.command(request, identity, self._brick)
            told = reply_of(report, self._dictionary.entry(command), self._brick)
            for message in (claim := replace(command, received=True), told):
                encode(message)
        except MopsError as error:
            _LOG.debug("%s has no message: %s", identity, error)
            return
        self._send(identity, claim, told)

    def _send(self, key: Identity | None, *messages: Message) -> None:
        text = "".join(map(str, messages))
        self._unconfirmed.pop(key, None)
        self._unconfirmed[key] = text
        if len(self._unconfirmed) > MOST_UNCONFIRMED:
            del self._unconfirmed[next(iter(self._unconfirmed))]
        self._publish(text)

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Tell nothing: the brick measures."""

    def file(self, event: FileEvent) -> None:
        """Tell nothing."""

    def plan(self, update: PlanUpdate) -> None:
        """Tell nothing: what a plan commands is reported."""
