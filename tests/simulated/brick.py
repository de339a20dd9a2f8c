"""MOCUP's brick in simulated time, and USB as `rover-nxt` has it."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import copysign
from typing import Final

from adapters.mocup.brick.usb import (
    OUTGOING,
    BrickConnected,
    BrickDisconnected,
    OctetsReceived,
    SessionEvent,
)
from adapters.mops import TO_ALL, Message, MopsStream, encode, load_dictionary, telemetry_of
from executive.commands import (
    DriveFor,
    MoveForward,
    Request,
    RotateBy,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetRotateSpeed,
    SetTravelSpeed,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.parameters import Parameter
from executive.values.ports import CameraIntent
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.simulated.process import Process
from tests.simulated.world import World
from tests.support.kinematic import KinematicRover

NAME: Final = "MOCUP"
DICTIONARY: Final = load_dictionary()
_STOP: Final = DICTIONARY.spelling.commands["stop"]
_LATENCY_S: Final = (0.02, 0.15)
_USB_S: Final = (0.001, 0.02)
_CLAIM_S: Final = (0.2, 2.0)
_SILENT_S: Final = 0.5
"""The brick stops when no octet has come for longer."""
_POLL_S: Final = 0.1
_MOVING_S, _REST_S = 0.2, 1.0
"""Between two times that telemetry is sent."""
_UNREAD: Final = 20
"""Messages that USB holds while nobody reads."""


class SimBrick:
    """Does one thing at a time; a stop comes between. It goes on while nobody is connected.

    Args:
        world: its time.

    Attributes:
        begun: what it began, with the times.
        stops: the stops that it received, with the times.
        executed: what it ended as executed.
        rover: its wheels and its camera.
    """

    def __init__(self, world: World) -> None:
        self._world, self._chance = world, world.random("brick")
        self.rover = KinematicRover(spin_centre_m=0.0)
        self.plugged = True
        self.begun: list[tuple[float, Message]] = []
        self.stops: list[tuple[float, Message]] = []
        self.executed: list[Message] = []
        self._session: SimSession | None = None
        self._unread: deque[bytes] = deque(maxlen=_UNREAD)
        self._task: Message | None = None
        self._travel_mps, self._rotate_radps, self._moved_s = 0.2, 1.0, 0.0
        self._received_s = 0.0
        world.after(_REST_S, self._measure)

    def plug(self, plugged: bool) -> None:
        """Connect its cable, or take it off; what was on its way is lost."""
        if plugged == self.plugged:
            return
        self.plugged = plugged
        if not plugged:
            self._unread.clear()
        if self._session is not None:
            self._session.on_plug(plugged)

    def attach(self, session: "SimSession") -> None:
        """Be claimed; what nobody has read is read first, unless the driver dropped it."""
        self._session = session
        if self._chance.random() < 0.5:
            self._unread.clear()
        while self._unread:
            session.receive(self._unread.popleft())

    def take(self, octets: bytes) -> None:
        """Receive whole messages."""
        self._received_s = self._world.now_s
        for message in MopsStream(lambda line: self._world.note(f"brick ! {line}")).feed(octets):
            self._take(message)

    def _take(self, message: Message) -> None:
        self._world.note(f"brick {message}")
        if message.code == _STOP:
            self.stops.append((self._world.now_s, message))
            self._end(Stage.CANCELLED, Reason.STOPPED)
            self._reply(message, Stage.EXECUTED)
        elif self._task is not None:
            self._reply(message, Stage.REJECTED, Reason.QUEUE_FULL)
        else:
            self._task = message
            self._world.after(self._chance.uniform(*_LATENCY_S), self._begin, message)
            self._watch(message)

    def _begin(self, command: Message) -> None:
        if self._task is not command:
            return
        self.begun.append((self._world.now_s, command))
        takes_s = self._carry_out(DICTIONARY.request(command))
        if takes_s:
            self._reply(command, Stage.STARTED)
        self._world.after(takes_s, self._done, command)

    def _carry_out(self, request: Request) -> float:
        """Begin to do something; return how long it takes."""
        self._move()
        match request:
            case MoveForward(distance_m):
                self.rover.velocity = Velocity(copysign(self._travel_mps, distance_m), 0.0)
                return abs(distance_m) / self._travel_mps
            case RotateBy(angle_rad):
                self.rover.velocity = Velocity(0.0, copysign(self._rotate_radps, angle_rad))
                return abs(angle_rad) / self._rotate_radps
            case DriveFor(travel_mps, rotate_radps, duration_s):
                self.rover.velocity = Velocity(travel_mps, rotate_radps)
                return duration_s
            case SetTravelSpeed(speed_mps):
                self._travel_mps = speed_mps
            case SetRotateSpeed(speed_radps):
                self._rotate_radps = speed_radps
            case SetCameraAngles(pan_rad, tilt_rad):
                now = self.rover.angles
                pan_rad = now.pan_rad if pan_rad is None else pan_rad
                tilt_rad = now.tilt_rad if tilt_rad is None else tilt_rad
                self.rover.point_camera(CameraIntent(pan_rad, tilt_rad, 1.0))
            case SetCameraRotateSpeed():
                pass
            case _:
                raise AssertionError(request)
        return 0.0

    def _done(self, command: Message) -> None:
        if self._task is command:
            self.executed.append(command)
            self._end(Stage.EXECUTED)

    def _end(self, stage: Stage, reason: Reason | None = None) -> None:
        self._move()
        self.rover.velocity = STANDING
        task, self._task = self._task, None
        if task is not None:
            self._send_telemetry()
            self._reply(task, stage, reason)

    def _move(self) -> None:
        now_s = self._world.now_s
        self.rover.advance(now_s - self._moved_s)
        self._moved_s = now_s

    def _watch(self, command: Message) -> None:
        """Stop by itself when the host is silent."""
        if self._task is not command:
            return
        if self._session is not None and self._session.keeps_alive:
            self._received_s = self._world.now_s
        if self._world.now_s - self._received_s > _SILENT_S:
            self._end(Stage.CANCELLED, Reason.INTERRUPTED)
        else:
            self._world.after(_POLL_S, self._watch, command)

    def _reply(self, command: Message, stage: Stage, reason: Reason | None = None) -> None:
        reply = replace(
            command,
            source=command.dest,
            dest=command.source,
            inputs=(),
            outputs=(stage.name, "" if reason is None else reason.name, ""),
            received=stage is not Stage.REJECTED,
            executed=stage is Stage.EXECUTED,
        )
        self._send(reply)

    def _measure(self) -> None:
        self._move()
        self._send_telemetry()
        standing = self.rover.velocity == STANDING
        self._world.after(_REST_S if standing else _MOVING_S, self._measure)

    def _send_telemetry(self) -> None:
        pose, velocity, angles = self.rover.pose, self.rover.velocity, self.rover.angles
        measured = {
            Parameter.POS_X: pose.x_m,
            Parameter.POS_Y: pose.y_m,
            Parameter.HEAD: pose.heading_rad,
            Parameter.TRAVEL_SPEED: self._travel_mps,
            Parameter.ROTATE_SPEED: self._rotate_radps,
            Parameter.CURRENT_TRAVEL_SPEED: velocity.travel_mps,
            Parameter.CURRENT_ROTATE_SPEED: velocity.rotate_radps,
            Parameter.BATERY_VOLTAGE: 7.9,
            Parameter.CAM_PAN: angles.pan_rad,
            Parameter.CAM_TILT: angles.tilt_rad,
            Parameter.CAM_ROTATE_SPEED: 1.0,
        }
        spelling = DICTIONARY.spelling.telemetry
        self._send(replace(telemetry_of(measured, spelling, NAME, TO_ALL), received=False))

    def _send(self, message: Message) -> None:
        if self._session is not None and self._session.connected:
            self._session.receive(encode(message))
        elif self.plugged:
            self._unread.append(encode(message))


class SimSession:
    """`BrickSession` in simulated time, of one life of `rover-nxt`.

    Args:
        process: `rover-nxt`.
        brick: at its cable.
        wake: called when an event waits.
    """

    def __init__(self, process: Process, brick: SimBrick, wake: Callable[[], None]) -> None:
        self._process, self._incarnation, self._brick, self._wake = (
            process,
            process.present,
            brick,
            wake,
        )
        self._chance = process.world.random("usb")
        self._events: list[SessionEvent] = []
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._durable = 0
        self._stops: deque[tuple[int, bytes]] = deque()
        self._visits, self._plugs = 0, 0
        self._writing = self._there = False
        self._last_s = 0.0

    def start(self) -> None:
        """Begin to look for the brick."""
        brick = self._brick
        brick._session = self
        self.on_plug(brick.plugged)

    @property
    def connected(self) -> bool:
        """Whether a brick is there, and a process that is alive."""
        return self._there and self._incarnation.alive

    @property
    def keeps_alive(self) -> bool:
        """Whether the brick receives keep-alives of its host."""
        return self.connected and not self._process.paused

    def on_plug(self, plugged: bool) -> None:
        """Notice that the brick is there, or is gone."""
        self._plugs += 1
        if plugged:
            self._later(self._chance.uniform(*_CLAIM_S), partial(self._claim, self._plugs))
        elif self._there:
            self._there = False
            self._stops.clear()
            self._outgoing.clear()
            self._later(_POLL_S, partial(self._put, BrickDisconnected("USB: No such device")))

    def send(self, octets: bytes, visit: int, commit: int) -> bool:
        """See `BrickSession.send`."""
        if not self._there or visit != self._visits or len(self._outgoing) >= OUTGOING:
            return False
        self._outgoing.append((commit, octets))
        self._write_soon()
        return True

    def stop(self, octets: bytes) -> bool:
        """See `BrickSession.stop`."""
        if not self._there or len(self._stops) >= OUTGOING:
            return False
        self._outgoing.clear()
        self._stops.append((0, octets))
        self._write_soon()
        return True

    def release(self, commit: int) -> None:
        """See `BrickSession.release`."""
        self._durable = commit
        if self._next():
            self._write_soon()

    def events(self) -> list[SessionEvent]:
        """Take what happened since."""
        taken, self._events = self._events, []
        return taken

    def receive(self, octets: bytes) -> None:
        """Read octets of the brick, a little later and in their order."""
        world = self._process.world
        self._last_s = max(self._last_s, world.now_s + self._chance.uniform(*_USB_S))
        self._later(self._last_s - world.now_s, partial(self._read, self._plugs, octets))

    def _read(self, plugs: int, octets: bytes) -> None:
        if plugs == self._plugs:
            self._put(OctetsReceived(octets))

    def _claim(self, plugs: int) -> None:
        if plugs != self._plugs:
            return
        self._visits += 1
        self._put(BrickConnected(self._visits))
        self._there = True
        self._brick.attach(self)

    def _write_soon(self) -> None:
        if not self._writing:
            self._writing = True
            self._later(self._chance.uniform(*_USB_S), self._write)

    def _write(self) -> None:
        self._writing = False
        waiting = self._next()
        if self._there and waiting:
            self._brick.take(waiting.popleft()[1])
        if self._next():
            self._write_soon()

    def _next(self) -> deque[tuple[int, bytes]] | None:
        waiting = self._stops or self._outgoing
        return waiting if waiting and waiting[0][0] <= self._durable else None

    def _put(self, event: SessionEvent) -> None:
        self._events.append(event)
        self._wake()

    def _later(self, delay_s: float, callback: Callable[[], object]) -> None:
        if self._incarnation.alive:
            self._process.loop.call_later(delay_s, callback)
