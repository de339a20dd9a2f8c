"""Who reads MOPS strings without ROS, and what must not become of a string there."""

import asyncio
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from enum import Enum, unique
from itertools import count
from pathlib import Path
from typing import Any, Final, Protocol

from adapters.bundle import Address, BundleId, Delivery, Ipn, Listen
from adapters.bundle.codec.bundle import Creation
from adapters.bundle.node.settings import UdpLink
from adapters.mal import Codec, InteractionStage, Operation
from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import Router
from adapters.mops import (
    Dictionary,
    Message,
    MopsError,
    MopsStream,
    RelayAuthority,
    decode,
    encode,
    facts_of,
    health_of,
    housekeeping_of,
    parameters_of,
    report_of,
)
from adapters.mrs.spec import mrs_specification, notification_of, parameter_value
from adapters.relay.orbiter import OrbiterSettings, RelayedRoverSettings
from adapters.relay.orbiter.link_status import aboard_values
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.rover.bridge import SendQueue
from executive.commands.catalogue import Request
from executive.values.clock import ManualClock
from executive.values.parameters import ParameterValue
from executive.values.reports import Identity, Report
from tests.stress.findings import Findings, Lines
from tests.stress.mops_grammar import Cut, Stream, cut, is_sound

MAX_LINE: Final = 6000
"""Characters of a line that names a message of 4096 octets."""


@unique
class Fault(Enum):
    """A promise that was broken."""

    RAISED = "raised something else than a refusal"
    LENIENT = "taken though wrong"
    DEAF = "not taken though sound"
    CHANGED = "read otherwise than it was written"
    SILENT = "wrong and not told"
    WORDY = "told in more than one line"
    UNCALLED = "said or done though no sound string asked for it"
    MOVED = "motion"


class MopsFindings(Findings):
    """Counts faults, of whoever reads strings."""

    def compare(self, octets: bytes, sound: Sequence[bytes], taken: Sequence[bytes]) -> None:
        """Compare what should be taken of octets with what was."""
        wanted, found = Counter(sound), Counter(taken)
        for _ in (found - wanted).elements():
            self.add(Fault.LENIENT, octets)
        for _ in (wanted - found).elements():
            self.add(Fault.DEAF, octets)

    def reported(self, octets: bytes, lines: Sequence[str], least: int, maximum: int) -> None:
        """Check that so many lines were told."""
        if len(lines) < least:
            self.add(Fault.SILENT, octets)
        if len(lines) > maximum or any(map(_is_long, lines)):
            self.add(Fault.WORDY, (octets, lines))


def _is_long(line: str) -> bool:
    return "\n" in line or len(line) > MAX_LINE


BRICK: Final = "MOCUP"
STOP_CODE: Final = 0x10E
_MAX_QUEUED: Final = 4


class Reader(Protocol):
    """Takes strings."""

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        """Take octets in portions, and count what is wrong with what becomes of them."""
        ...

    def close(self) -> None:
        """Take no more."""
        ...


class Parsers:
    """The stream, and everything that makes something of a message."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._dictionary, self._lines = dictionary, list[str]()
        self._stream, self._judge = MopsStream(self._lines.append), Stream()
        self._tray = SendQueue(dictionary, _MAX_QUEUED)

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        octets = b"".join(portions)
        wanted = self._judge.cut(octets)
        self._lines.clear()
        messages = [each for portion in portions for each in self._stream.feed(portion)]
        findings.compare(octets, wanted.sound, [encode(message) for message in messages])
        findings.reported(octets, self._lines, wanted.wrong, wanted.wrong)
        for message in messages:
            self._read(message, findings)

    def close(self) -> None:
        """Do nothing: nothing is open."""

    def _read(self, message: Message, findings: MopsFindings) -> None:
        dictionary = self._dictionary
        telemetry, link = dictionary.spelling.telemetry, dictionary.spelling.link
        with suppress(MopsError):
            report_of(message, dictionary, 0.0)
        with suppress(MopsError):
            health_of(message, link)
        with suppress(MopsError):
            housekeeping_of(message, dictionary.spelling.housekeeping)
        with suppress(MopsError):
            parameters_of(message, telemetry, 0.0)
            tuple(facts_of(message, telemetry, 0.0))
        self._tray.put(str(message), self._lines.append)
        self._tray.pop(0, 1)
        with suppress(MopsError):
            self._write(dictionary.request(message), message.dest, findings)

    def _write(self, request: Request, dest: str, findings: MopsFindings) -> None:
        try:
            again = self._dictionary.command(request, Identity("MOE", 1), dest)
            same = self._dictionary.request(again) == request
        except MopsError:
            same = False
        if not same:
            findings.add(Fault.CHANGED, request)


class Brick:
    """The router of `rover-nxt`, between two links and a brick that answers in strings as wrong."""

    def __init__(self, dictionary: Dictionary) -> None:
        self._lines = list[str]()
        self._router = Router(
            dictionary,
            BRICK,
            self,
            self._lines.append,
            BrickRecord(),
            RelayAuthority(needed=False),
            ManualClock(),
        )
        self._judge, self._turns = Stream(), count()
        self._sent: list[bytes] = []
        self._output: list[Message] = []

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        octets = b"".join(portions)
        for stored in (self._lines, self._sent, self._output):
            stored.clear()
        path = (None, *BrickLink)[next(self._turns) % 3]
        if path is None:
            wanted = self._judge.cut(octets)
            for portion in portions:
                self._router.on_octets(portion)
            requested: list[bytes] = []
        else:
            text = octets.decode("utf-8", "replace")
            wanted = cut(text.encode("utf-8"))
            self._router.process(path, text)
            requested = [
                _plain(each) for each in wanted.sound if each.split(b"|")[2] == BRICK.encode()
            ]
        findings.reported(octets, self._lines, wanted.wrong, wanted.wrong + len(wanted.sound))
        for sent in self._sent:
            if sent not in requested:
                findings.add(Fault.MOVED, (octets, sent))
        for message in self._output:
            if not wanted.sound or not is_sound(encode(message)):
                findings.add(Fault.UNCALLED, (octets, message))

    def close(self) -> None:
        """Do nothing: nothing is open."""

    def to_brick(self, octets: bytes, visit: int) -> bool:
        """Keep what the brick is sent, which is always there."""
        del visit
        return self.stop_brick(octets)

    def stop_brick(self, octets: bytes) -> bool:
        """Keep a stop; it has no more than a stop needs."""
        self._sent.append(octets)
        return True

    def notify(self, link: BrickLink, message: Message) -> None:
        self._output.append(message)

    def publish_telemetry(self, message: Message) -> None:
        self._output.append(message)


def _plain(octets: bytes) -> bytes:
    """Return a message as the brick is sent it: no outputs; a stop, by its code, nothing at all."""
    message = replace(decode(octets), outputs=())
    if message.code == STOP_CODE:
        message = replace(message, inputs=(), received=False)
    return encode(message)


class Orbiter:
    """The rover of `rover-mops`: bundles with strings come down, reports are told."""

    def __init__(self, dictionary: Dictionary, folder: Path, asset: str) -> None:
        link = UdpLink(Address("127.0.0.1", 9))
        rover = RelayedRoverSettings(
            asset=asset.lower(), description="", domain=(asset,), eid="ipn:2.1", port=0, udp=link
        )
        listen = Listen(udp=link.address)
        settings = OrbiterSettings(eid="ipn:1.1", rovers=(rover,), listen=listen)
        self._relay = OrbiterRelay(settings, folder, lambda: None, dictionary)
        (self._rover,) = self._relay.rovers.values()
        self._rover.listener = self
        self._loop = asyncio.Runner()
        self._log, self._numbers = Lines("adapters.relay.orbiter"), count(1)
        self._asset = asset.encode()
        self._reported = 0
        specification = mrs_specification()
        self._codec = Codec(specification)
        self._notifications = specification.operation("Notification", "getNotifications")
        self._values = specification.operation("Monitoring", "getValue")

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        octets = b"".join(portions)
        wanted = self._wanted(octets)
        self._log.lines.clear()
        self._reported = 0
        creation = Creation(848_000_000_000, next(self._numbers))
        self._rover.on_delivery(Delivery(BundleId(Ipn(2, 1), creation), Ipn(1, 1), octets))
        self._loop.run(self._rover.settle())
        self._encode(self._values, aboard_values(self._rover.aboard))
        findings.reported(octets, self._log.lines, wanted.wrong, wanted.wrong + len(wanted.sound))
        ours = [each for each in wanted.sound if each.split(b"|")[1] == self._asset]
        if self._reported > len(ours):
            findings.add(Fault.UNCALLED, octets)

    def close(self) -> None:
        for rover in self._relay.rovers.values():
            rover.record.close()
        self._loop.close()
        self._log.close()

    def on_report(self, report: Report, cursor: int | None) -> None:
        """Count what is told of the rover, but not what the relay says of itself; encode it."""
        self._reported += report.link is not None or bool(report.sequence)
        self._encode(self._notifications, (notification_of(report, cursor),))

    def on_telemetry(self, values: Sequence[ParameterValue]) -> None:
        self._reported += 1
        self._encode(self._values, tuple(map(parameter_value, values)))

    def _encode(self, operation: Operation, values: Sequence[Any]) -> None:
        self._codec.encode(operation.parts[InteractionStage.REQUEST_RESPONSE], (values,))

    @staticmethod
    def _wanted(octets: bytes) -> Cut:
        return cut(octets.decode("ascii", "replace").encode("utf-8"))
