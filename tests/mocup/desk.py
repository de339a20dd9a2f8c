"""MOCUP's plugin on a desk: what it sends, and what it tells."""

from dataclasses import replace

from adapters.mocup import MocupFact, MocupRover
from adapters.mops import Message, encode, load_dictionary
from executive.clock import ManualClock
from executive.geometry import Velocity
from executive.ports import Advance, Hold, TurnBy, WholeMotion
from executive.reports import Identity

DICTIONARY = load_dictionary()
MOE7, MOE8 = Identity("MOE", 7), Identity("MOE", 8)
LINE = WholeMotion(1, Advance(1.5, 0.2), MOE7)
TURN = WholeMotion(2, TurnBy(0.5, 1.0), MOE7)
HOLD = WholeMotion(7, Hold(Velocity(0.1, 0.2), 3.0), MOE7)


class Desk:
    """A plugin, and the ends of both its wires."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.sent: list[Message] = []
        self.ended: list[MocupFact] = []
        self.rover = MocupRover(
            DICTIONARY, self.clock, self.send, self.ended.append, "EXEC", "MOCUP"
        )

    def send(self, message: Message) -> None:
        encode(message)
        self.sent.append(message)

    @property
    def commands(self) -> list[str]:
        return [message.command for message in self.sent]

    def answer(self, executed: bool = True, received: bool = True, *outputs: str) -> None:
        self.rover.take(reply(self.sent[-1], executed, received, *outputs))


def reply(to: Message, executed: bool, received: bool = True, *outputs: str) -> Message:
    return replace(
        to,
        source=to.dest,
        dest=to.source,
        inputs=(),
        outputs=outputs,
        received=received,
        executed=executed,
    )
