"""`MocupRover`, behind the port `DelegatedMotionRover`: sends the executive's motions as MOPS.

The brick executes one command at a time, so commands wait here for the reply to the one before; a
stop does not wait. Messages of a command of mission control carry its source and number, with a
counter, so that `rover-nxt` recognises copies from both links. Independent of ROS and of a clock:
messages leave by `send` and are passed to `take`.
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
from executive.core.authority import Grant
from executive.settings import AuthoritySettings
from executive.values.clock import Clock
from executive.values.facts import (
    ExternalAuthorityUse,
    ExternalCommandEnded,
    ExternalCommandRunning,
    ExternalStop,
    MotionEnded,
    MotionStarted,
)
from executive.values.parameters import ParameterValue
from executive.values.ports import CameraIntent, DelegatedMotion, DriveBy, TurnBy, VelocityHold
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, Stage

_LOG: Final = logging.getLogger(__name__)

RETRANSMIT_S: Final = 1.0
"""Period of repeating an unanswered command and camera angles. Chosen, not measured."""
ANSWER_TIMEOUT_S: Final = 3.0
"""Timeout of the reply to a command that is not a motion. Chosen, not measured."""
MAX_PENDING: Final = 64
"""Maximum number of commands with a pending reply."""
MAX_UNCONFIRMED: Final = 200
"""Maximum number of last reports that are published until `rover-nxt` acknowledges them."""
MocupFact = (
    MotionStarted
    | MotionEnded
    | ExternalCommandEnded
    | ExternalCommandRunning
    | ExternalStop
    | ExternalAuthorityUse
)
"""Facts that the plugin reports to the executive."""
_OF_CAMERA: Final = (SetCameraRotateSpeed, SetCameraAngles)
_ANNOUNCED_STAGES: Final = frozenset(Stage) - {Stage.RECEIVED, Stage.REJECTED, Stage.PROGRESS}


@dataclass(frozen=True, slots=True)
class _BrickRequest:
    request: Request
    command: Identity | None = None
    motion: DelegatedMotion | None = None


@dataclass(frozen=True, slots=True)
class _ReplyKey:
    """Source, number and counter of a command, repeated in its replies."""

    identity: Identity
    counter: int | None


class MocupRover:
    """Commands one brick.

    Args:
        send: called with each message to the brick.
        observe: called with the end of each whole motion, and the results of commands that arrived
            over the other link first.
        source: source of messages of no command.
        dest: name of the brick.
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
        self._pending: dict[_ReplyKey, _BrickRequest] = {}
        self._last: _ReplyKey | None = None
        self._unanswered: Message | None = None
        self._last_at_s = self._sent_at_s = 0.0
        self._speeds: dict[type, Request] = {}
        self._speeds_of: Identity | None = None
        self._camera: CameraIntent | None = None
        self._camera_at_s = 0.0

    def execute_motion(self, motion: DelegatedMotion) -> None:
        """Queue a motion for the brick.

        Its speed is set first if it differs or belongs to another command: the other link may have
        changed it since.
        """
        if motion.command != self._speeds_of:
            self._speeds.clear()
            self._speeds_of = motion.command
        match motion.primitive:
            case TurnBy(angle_rad, speed_radps):
                self._set(SetRotateSpeed(speed_radps), motion.command)
                request: Request = RotateBy(angle_rad)
            case DriveBy(distance_m, speed_mps):
                self._set(SetTravelSpeed(speed_mps), motion.command)
                request = MoveForward(distance_m)
            case VelocityHold(velocity, duration_s):
                request = DriveFor(velocity.travel_mps, velocity.rotate_radps, duration_s)
            case _:
                assert_never(motion.primitive)
        self._put(_BrickRequest(request, motion.command, motion))

    @property
    def moving(self) -> bool:
        """Whether the brick executes a motion of the executive, or one is queued."""
        requests = (*self._pending.values(), *self._waiting)
        return any(pending.motion is not None for pending in requests)

    def halt(self) -> None:
        """Send a stop at once; the queue is cleared."""
        self._waiting.clear()
        self._speeds.clear()
        self._send_request(_BrickRequest(Stop()))

    def emergency_stop(self) -> None:
        """Send a stop at once, from any thread; changes no state here."""
        key = _ReplyKey(Identity(self._source, next(self._numbers)), None)
        self._send(self._message(Stop(), key))

    def point_camera(self, wanted: CameraIntent) -> None:
        """Point the camera; equal angles are sent again only after `RETRANSMIT_S`."""
        now_s = self._clock.now_s()
        if wanted != self._camera:
            self._waiting = deque(e for e in self._waiting if not isinstance(e.request, _OF_CAMERA))
            self._put(_BrickRequest(SetCameraRotateSpeed(wanted.speed_radps), wanted.command))
        elif now_s - self._camera_at_s < RETRANSMIT_S:
            return
        self._camera, self._camera_at_s = wanted, now_s
        self._put(_BrickRequest(SetCameraAngles(wanted.pan_rad, wanted.tilt_rad), wanted.command))

    def retransmit(self) -> None:
        """Retransmit an unanswered command under its number; call regularly.

        A command may be lost before it reaches `rover-nxt`, which sends each command to the brick
        at most once.
        """
        if self._unanswered is not None and self._clock.now_s() - self._sent_at_s >= RETRANSMIT_S:
            self._sent_at_s = self._clock.now_s()
            self._send(self._unanswered)
        self._send_next()

    def on_reply(self, reply: Message) -> None:
        """Process a reply of the brick; one that answers no command is ignored.

        Raises:
            MopsError: it is an authority message with an invalid authority.
        """
        if reply.code == self._dictionary.spelling.authority.code:
            epoch = authority_of(reply).epoch
            if epoch is not None:
                self._observe(ExternalAuthorityUse(epoch))
            return
        key = _key_of(reply)
        if self._is_anothers_stop(reply):
            self._on_external_stop(reply)
            return
        if key is None:
            _LOG.debug("reply to no command: %s", reply)
            return
        if key not in self._pending:
            if key.counter is None:
                self._on_external_report(key.identity, reply)
            return
        if key == self._last:
            self._unanswered = None
        if is_last(reply):
            self._end(key, reply)
            self._send_next()
        elif reply.outputs[:1] == (Stage.STARTED.name,):
            motion = self._pending[key].motion
            if motion is not None:
                self._observe(MotionStarted(motion.number))

    def _on_external_stop(self, stop: Message) -> None:
        """End all commands sent to the brick, as the other link has stopped it."""
        number = stop.moe_inputs_id
        self._observe(ExternalStop(None if number is None else Identity(stop.dest, number)))
        requests = (*self._pending.values(), *self._waiting)
        self._pending = {k: e for k, e in self._pending.items() if isinstance(e.request, Stop)}
        self._waiting.clear()
        self._speeds.clear()
        if self._last not in self._pending:
            self._last = self._unanswered = None
        for pending in requests:
            self._report_end(pending, stop)

    def _is_anothers_stop(self, reply: Message) -> bool:
        """Return whether a reply is the notification of a stop over the other link."""
        begun = reply.outputs[:1] == (Stage.STARTED.name,)
        return begun and reply.code == self._stop and reply.dest != self._source

    def _on_external_report(self, command: Identity, reply: Message) -> None:
        if is_last(reply):
            self._on_external_result(command, reply)
        else:
            self._observe(ExternalCommandRunning(command))

    def _on_external_result(self, command: Identity, reply: Message) -> None:
        """End the requests of a command that the brick received over the other link."""
        theirs = [pending for pending in self._waiting if pending.command == command]
        self._waiting = deque(e for e in self._waiting if e.command != command)
        for key in [key for key, pending in self._pending.items() if pending.command == command]:
            self._end(key, reply)
        for pending in theirs:
            self._report_end(pending, reply)
        self._observe(ExternalCommandEnded(command, reply.executed, _reply_text(reply)))
        self._send_next()

    def _end(self, key: _ReplyKey, reply: Message) -> None:
        pending = self._pending.pop(key)
        if not reply.executed:
            level = logging.INFO if Stage.CANCELLED.name in reply.outputs[:1] else logging.WARNING
            _LOG.log(level, "%s not executed: %s", reply.command, _reply_text(reply))
            self._speeds.pop(type(pending.request), None)
            self._drop_motion_after(pending, reply)
        self._report_end(pending, reply)
        if key == self._last:
            self._last = self._unanswered = None

    def _drop_motion_after(self, pending: _BrickRequest, reply: Message) -> None:
        """Drop a queued motion after the brick refused its speed."""
        following = self._waiting[0] if self._waiting else None
        if (
            isinstance(pending.request, SetTravelSpeed | SetRotateSpeed)
            and following is not None
            and following.motion is not None
            and following.command == pending.command
        ):
            self._report_end(self._waiting.popleft(), reply)

    def _report_end(self, pending: _BrickRequest, reply: Message) -> None:
        if pending.motion is not None:
            self._observe(MotionEnded(pending.motion.number, reply.executed, _reply_text(reply)))

    def _set(self, speed: SetTravelSpeed | SetRotateSpeed, command: Identity) -> None:
        if self._speeds.get(type(speed)) != speed:
            self._speeds[type(speed)] = speed
            self._put(_BrickRequest(speed, command))

    def _put(self, pending: _BrickRequest) -> None:
        self._waiting.append(pending)
        self._send_next()

    def _send_next(self) -> None:
        if self._waiting and not self._busy:
            self._send_request(self._waiting.popleft())

    @property
    def _busy(self) -> bool:
        """Whether the next command has to wait for a reply of the brick."""
        sent = None if self._last is None else self._pending.get(self._last)
        if sent is None:
            return False
        return sent.motion is not None or self._clock.now_s() - self._last_at_s < ANSWER_TIMEOUT_S

    def _send_request(self, pending: _BrickRequest) -> None:
        command = pending.command
        key = None if command is None else _ReplyKey(command, next(self._counters))
        if key is None or not self._can_be_sent(pending.request, key):
            key = _ReplyKey(Identity(self._source, next(self._numbers)), None)
        self._last = key
        self._last_at_s = self._sent_at_s = self._clock.now_s()
        self._pending[key] = pending
        if len(self._pending) > MAX_PENDING:
            del self._pending[next(iter(self._pending))]
        self._unanswered = self._message(pending.request, key)
        self._send(self._unanswered)

    def _can_be_sent(self, request: Request, key: _ReplyKey) -> bool:
        """Return whether a command's source is valid in messages; a relayed one's always is."""
        try:
            encode(self._message(request, key))
        except MopsError:
            return False
        return True

    def _message(self, request: Request, key: _ReplyKey) -> Message:
        message = self._dictionary.command(request, key.identity, self._dest)
        return replace(message, moe_inputs_counter=key.counter)


def _key_of(reply: Message) -> _ReplyKey | None:
    if reply.moe_inputs_id is None:
        return None
    return _ReplyKey(Identity(reply.dest, reply.moe_inputs_id), reply.moe_inputs_counter)


def _reply_text(reply: Message) -> str:
    return " ".join(part for part in reply.outputs[:3] if part)


def relay_authority(settings: AuthoritySettings, grant: Grant) -> RelayAuthority:
    """Return the authority of the relay's commands after the last grant."""
    if grant.holder != settings.relay:
        return RelayAuthority(bool(settings.needed), grant.holder)
    return RelayAuthority(bool(settings.needed), grant.holder, grant.epoch, grant.granted_by)


class ClaimAnnouncer:
    """Downlink that publishes the executive's commands and the authority to `rover-nxt`.

    `rover-nxt` connects both links (thesis 6.2). It must know commands that reach the brick in
    parts, later or never, to recognise the relay's copies, and their reports, for the relay.
    A claim is the command as a MOPS message with RECEIVED set; a report is a reply. Both are one
    string, so that only the last of several must arrive: it is published again until `rover-nxt`
    acknowledges it.

    A command that the executive refused is not claimed, because it cannot be executed twice; nor is
    one that has no MOPS message.

    The authority is published after each hand-over, before any command of its new holder.

    Args:
        request_of: returns the request of a command, or None if unknown.
        authority: returns the authority of the relay's commands.
        source: source of the authority messages.
        brick: name of the brick, and source of the reports.
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
        self._announced_authority: RelayAuthority | None = None
        self._publish = publish
        self._source = source
        self._brick = brick
        self._unconfirmed: dict[Identity | None, str] = {}
        """Last string for each command, and for the authority (None)."""
        self._before: dict[Identity | None, str] = {}

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Publish new reports on commands, and the authority after a hand-over."""
        for report in reports:
            if report.identity is None:
                self._announce_authority()
            else:
                self._announce(report, report.identity)

    def resend(self, reports: Iterable[Report]) -> None:
        """Publish the authority and the last report on each command, for a new subscriber."""
        self._announced_authority = None
        self._announce_authority()
        last = {each.identity: each for each in reports if each.stage in _ANNOUNCED_STAGES}
        for identity, report in last.items():
            if identity is not None:
                self._announce(report, identity)

    def on_acknowledged(self, mark: int) -> None:
        """Process the acknowledgement of the string with this fingerprint."""
        for key, text in self._unconfirmed.items():
            if fingerprint(text) == mark:
                del self._unconfirmed[key]
                return

    def poll(self) -> None:
        """Publish again the strings that were unacknowledged at the last call already."""
        for key, text in self._unconfirmed.items():
            if self._before.get(key) == text:
                self._publish(text)
        self._before = dict(self._unconfirmed)

    def _announce_authority(self) -> None:
        authority = self._authority()
        if authority != self._announced_authority:
            self._announced_authority = authority
            entry = self._dictionary.spelling.authority
            self._send(None, authority_message(authority, entry, self._source, self._brick))

    def _announce(self, report: Report, identity: Identity) -> None:
        if report.stage not in _ANNOUNCED_STAGES:
            return
        request = self._request_of(identity)
        if request is None:
            return
        try:
            command = self._dictionary.command(request, identity, self._brick)
            reply = reply_of(report, self._dictionary.entry(command), self._brick)
            for message in (claim := replace(command, received=True), reply):
                encode(message)
        except MopsError as error:
            _LOG.debug("%s has no message: %s", identity, error)
            return
        self._send(identity, claim, reply)

    def _send(self, key: Identity | None, *messages: Message) -> None:
        text = "".join(map(str, messages))
        self._unconfirmed.pop(key, None)
        self._unconfirmed[key] = text
        if len(self._unconfirmed) > MAX_UNCONFIRMED:
            del self._unconfirmed[next(iter(self._unconfirmed))]
        self._publish(text)

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Ignore telemetry: the brick measures it."""

    def send_file_event(self, event: FileEvent) -> None:
        """Ignore file events."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Ignore plans: commands of a plan are reported."""
