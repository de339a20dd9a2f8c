"""MOCUP behind the port `MotionRover`, its plugin and its brick joined in one process."""

from adapters.mocup.plugin import MocupRover
from adapters.mops.codec import Message, MopsStream, encode
from adapters.mops.dictionary import load_dictionary
from adapters.mops.telemetry import facts_of
from executive.clock import Clock
from executive.facts import Fact
from executive.motions import WholeMotion
from executive.ports import CameraIntent
from sim.mocup import SimulatedMocup

SOURCE = "EXEC"


class MocupByWire:
    """What an executive sees of a simulated MOCUP: one plugin's life, on simulated time.

    Args:
        body: the rover with its brick.
        clock: the executive's.
        brick: the name by which the brick is addressed.
    """

    def __init__(self, body: SimulatedMocup, clock: Clock, brick: str) -> None:
        """Have nothing under way; what the brick does goes on."""
        self._body = body
        self._clock = clock
        self._due: list[Fact] = []
        dictionary = load_dictionary()
        self._telemetry = dictionary.spelling.telemetry
        self._stream = MopsStream(self._tell)
        self._plugin = MocupRover(dictionary, clock, self._send, self._due.append, SOURCE, brick)

    def carry_out(self, motion: WholeMotion) -> None:
        """Have a motion carried out."""
        self._plugin.carry_out(motion)

    def halt(self) -> None:
        """Have the brick stop."""
        self._plugin.halt()

    def point_camera(self, wanted: CameraIntent) -> None:
        """Have the camera pointed."""
        self._plugin.point_camera(wanted)

    def request_frame(self) -> None:
        """Ask for a picture: the camera is not on the brick."""
        self._body.request_frame()

    def facts(self) -> list[Fact]:
        """Return what the brick has said since the last call, and the picture asked for."""
        for message in self._stream.feed(self._body.brick.give()):
            if message.code == self._telemetry.code:
                self._due += facts_of(message, self._telemetry, self._clock.now_s())
            else:
                self._plugin.take(message)
        due = [*self._due, *self._body.facts()]
        self._due.clear()
        return due

    def _send(self, message: Message) -> None:
        self._body.hear(encode(message))

    @staticmethod
    def _tell(line: str) -> None:
        raise ValueError(f"the brick on the wire says nonsense: {line}")
