"""A router whose ports write down what leaves, and messages for it."""

from dataclasses import dataclass, field, replace

from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import SOURCE, Router
from adapters.mops import Message, RelayAuthority, decode, encode, load_dictionary
from executive.values.clock import ManualClock

DICTIONARY = load_dictionary()
SPELLING = DICTIONARY.spelling
STOP = DICTIONARY.commands["stop"]
FORWARD = DICTIONARY.commands["moveForward"]
TURN = DICTIONARY.commands["rotateBy"]
TELEMETRY = SPELLING.telemetry
BOTH = list(BrickLink)


@dataclass
class Ports:
    """Writes down what leaves; the brick takes commands while it is there."""

    there: bool = True
    brick: list[bytes] = field(default_factory=list)
    notified: list[tuple[BrickLink, Message]] = field(default_factory=list)
    measured: list[Message] = field(default_factory=list)

    def to_brick(self, octets: bytes, visit: int) -> bool:
        assert visit == 1 or not self.there
        return self.stop_brick(octets)

    def stop_brick(self, octets: bytes) -> bool:
        if self.there:
            self.brick.append(octets)
        return self.there

    def notify(self, link: BrickLink, message: Message) -> None:
        encode(message)
        self.notified.append((link, message))

    def publish_telemetry(self, message: Message) -> None:
        self.measured.append(message)


class Bench:
    def __init__(self) -> None:
        self.clock = ManualClock()
        self.authority = RelayAuthority(False)
        self.ports = Ports()
        self.reported: list[str] = []
        self.start(BrickRecord())

    def start(self, record: BrickRecord) -> None:
        self.router = Router(
            DICTIONARY,
            "MOCUP",
            self.ports,
            self.reported.append,
            record,
            self.authority,
            self.clock,
        )
        if self.ports.there:
            self.router.on_connected(1)

    def fill_disk(self, full: bool) -> None:
        """Let the record take nothing more, or mend it."""
        self.router.record.rows(f"PRAGMA query_only = {'ON' if full else 'OFF'}")

    def command(self, link: BrickLink, *messages: Message) -> bool:
        return self.router.process(link, "".join(str(message) for message in messages))

    def halted(self) -> Message:
        """Return the stop that the router has sent last of its own accord."""
        return [m for m in map(decode, self.ports.brick) if m.source == SOURCE][-1]

    def sends(self, *messages: Message) -> None:
        self.router.on_octets(b"".join(encode(message) for message in messages))


def forward(number: int | None = 7, source: str = "MOE", distance: str = "1.5") -> Message:
    command = FORWARD.command
    return Message(FORWARD.code, source, "MOCUP", command, (distance,), moe_inputs_id=number)


def stop(number: int) -> Message:
    return Message(STOP.code, "MOE", "MOCUP", STOP.command, moe_inputs_id=number)


def received(command: Message) -> Message:
    return replace(command, source="MOCUP", dest=command.source, inputs=(), received=True)


def executed(command: Message) -> Message:
    return replace(received(command), outputs=("EXECUTED",), executed=True)


def claimed(command: Message) -> Message:
    return replace(command, received=True)


def part(number: int, counter: int, angle: str = "0.5") -> Message:
    return Message(
        TURN.code,
        "MOE",
        "MOCUP",
        TURN.command,
        (angle,),
        moe_inputs_id=number,
        moe_inputs_counter=counter,
    )


def report(command: Message, stage: str) -> Message:
    outputs = (stage, "", "", "12", "1.5", "INFORMATIONAL")
    done = stage == "EXECUTED"
    return replace(
        command,
        source="MOCUP",
        dest="MOE",
        inputs=(),
        outputs=outputs,
        received=True,
        executed=done,
    )
