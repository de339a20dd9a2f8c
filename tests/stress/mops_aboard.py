"""Who reads strings aboard: the relay link of `rover-executive` and the executive behind it.

The rover knows no place, so that no command whatever may move it.
"""

import re
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Final

from adapters.mops import Dictionary, MopsError, fingerprint
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from executive.core.runner import Executive
from executive.record import Ledger, Synchronous
from executive.settings import Settings
from executive.values.clock import ManualClock
from executive.values.geometry import STANDING
from executive.values.reports import Identity, Stage
from tests.stress.findings import Lines
from tests.stress.mops_grammar import cut, is_sound
from tests.stress.mops_readers import Fault, MopsFindings
from tests.support.kinematic import KinematicRover, Received
from trees import RoverTree

TICK_EVERY: Final = 20
"""Strings from tick to tick."""


class Wire:
    """The topics of the link, with a subscriber; keeps what is published."""

    def __init__(self) -> None:
        self.output: list[str] = []
        self.taken: list[int] = []

    def publish(self, text: str) -> None:
        self.output.append(text)

    def confirm(self, mark: int) -> None:
        self.taken.append(mark)

    def count_listeners(self) -> int:
        return 1


class Aboard:
    """An executive in simulated time, and its relay link."""

    def __init__(self, dictionary: Dictionary, settings: Settings, folder: Path) -> None:
        self._asset, self._dictionary = settings.asset.upper().encode(), dictionary
        self._wire, self._rover, self._received = Wire(), KinematicRover(), Received()
        self._log = Lines("adapters.relay.rover.executive_link")
        self._refused: list[str] = []
        ledger = Ledger(folder / "ledger.sqlite", Synchronous.NORMAL)
        name = settings.asset.upper()
        self._link = ExecutiveRelayLink(self._wire, ledger, dictionary, name)
        self._clock, self._tick_s, self._turns = ManualClock(), settings.tick_s, count(1)
        self._executive = Executive(
            settings=settings,
            clock=self._clock,
            rover=self._rover,
            ledger=ledger,
            files=folder / "files",
            downlinks=[self._link, self._received],
            build_tree=RoverTree,
        )
        self._link.serve(self._executive.submit)

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        text = b"".join(portions).decode("utf-8", "replace")
        octets = text.encode("utf-8")
        wanted = cut(octets)
        for stored in (
            self._refused,
            self._wire.output,
            self._log.lines,
            *vars(self._received).values(),
        ):
            stored.clear()
        self._rover.sent.clear()
        try:
            self._link.command(text)
        except MopsError as error:
            self._refused.append(str(error))
        self._executive.serve_inbox()
        if next(self._turns) % TICK_EVERY == 0:
            self._pass_time()
        self._store()
        findings.reported(octets, [*self._refused, *self._log.lines], wanted.wrong > 0, 1)
        requested = {_identity(each) for each in wanted.sound if each.split(b"|")[2] == self._asset}
        for report in self._received.reports:
            if report.stage is Stage.ACCEPTED and report.identity not in requested:
                findings.add(Fault.UNCALLED, (octets, report.identity))
        for message in re.findall("[^#]*#?", "".join(self._wire.output))[:-1]:
            if not is_sound(message.encode("utf-8")):
                findings.add(Fault.CHANGED, message)
        if any(velocity != STANDING for velocity in self._rover.sent):
            findings.add(Fault.MOVED, octets)

    def close(self) -> None:
        self._executive.close()
        self._log.close()

    def _pass_time(self) -> None:
        self._clock.set(self._clock.now_s() + self._tick_s)
        self._executive.tick()
        self._link.poll()

    def _store(self) -> None:
        """Keep all that was told, and what is told thereupon."""
        for message in self._wire.output:
            self._link.on_confirmed(fingerprint(message))


def _identity(command: bytes) -> Identity:
    fields = command.split(b"|")
    return Identity(fields[1].decode(), int(fields[8] or 0))
