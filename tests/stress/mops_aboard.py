"""Who reads strings aboard: the relay link of `rover-executive` and the executive behind it.

The rover knows no place, so that no command whatever may move it.
"""

import re
from collections.abc import Callable, Sequence
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final, cast

from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.mops import Dictionary, fingerprint
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from adapters.ros import MessageError, Topic, declare_topic
from executive.clock import ManualClock
from executive.geometry import STANDING
from executive.record import Ledger, Synchronous
from executive.reports import Identity, Stage
from executive.runner import Executive
from executive.settings import Settings
from tests.stress.findings import Lines
from tests.stress.mops_grammar import cut, is_sound
from tests.stress.mops_readers import Fault, MopsFindings
from tests.support.kinematic import Heard, KinematicRover
from trees import RoverTree

TICK_EVERY: Final = 20
"""Strings from tick to tick."""


class Wire:
    """What the link needs of a ROS node: parameters, a topic that somebody listens to, a timer."""

    topic_name = "mops/relay/notification"

    def __init__(self) -> None:
        self.said: list[str] = []
        self.taken: list[int] = []

    def declare_parameter(self, name: str, *_: object) -> SimpleNamespace:
        values = {"topic": name, "reliability": "reliable", "depth": 100}
        return SimpleNamespace(value=values[name.rpartition(".")[2]])

    def create_publisher(self, *_: object) -> "Wire":
        return self

    def create_timer(self, period_s: float, callback: Callable[[], None], clock: object) -> None:
        self.look = callback

    def get_subscriptions_info_by_topic(self, name: str) -> list[SimpleNamespace]:
        return [SimpleNamespace(endpoint_gid=[1])]

    def get_subscription_count(self) -> int:
        return 1

    def publish(self, message: String | UInt64) -> None:
        if isinstance(message, String):
            self.said.append(message.data)
        else:
            self.taken.append(message.data)


class Aboard:
    """An executive in simulated time, and its relay link on a topic; the link's `Served`."""

    def __init__(self, dictionary: Dictionary, settings: Settings, folder: Path) -> None:
        self._asset, self._dictionary = settings.asset.upper().encode(), dictionary
        self._wire, self._rover, self._heard = Wire(), KinematicRover(), Heard()
        self._log = Lines("adapters.relay.rover.executive_link")
        self._refused: list[str] = []
        self._takers: dict[type, Callable[[Any], None]] = {}
        node = cast(Node, self._wire)
        ledger = Ledger(folder / "ledger.sqlite", Synchronous.NORMAL)
        stops, commands = (declare_topic(node, key, "") for key in ("relay_stop", "relay_command"))
        name = settings.asset.upper()
        self._link = ExecutiveRelayLink(node, stops, commands, ledger, dictionary, name)
        self._clock, self._tick_s, self._turns = ManualClock(), settings.tick_s, count(1)
        self._executive = Executive(
            settings=settings,
            clock=self._clock,
            rover=self._rover,
            ledger=ledger,
            files=folder / "files",
            downlinks=[self._link, self._heard],
            build_tree=RoverTree,
        )
        self._link.serve(self._executive.submit, self)

    def subscribe(self, kind: type, topic: Topic, callback: Callable[[Any], None]) -> None:
        self._takers[kind] = self.contained(callback)

    subscribe_apart = subscribe

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback whose refusals are kept; what else it raises goes up."""

        def call(*arguments: object) -> None:
            try:
                callback(*arguments)
            except MessageError as error:
                self._refused.append(str(error))

        return call

    def take(self, portions: Sequence[bytes], findings: MopsFindings) -> None:
        text = b"".join(portions).decode("utf-8", "replace")
        octets = text.encode("utf-8")
        wanted = cut(octets)
        for kept in (self._refused, self._wire.said, self._log.lines, *vars(self._heard).values()):
            kept.clear()
        self._rover.sent.clear()
        self._takers[String](String(data=text))
        self._executive.turn()
        if next(self._turns) % TICK_EVERY == 0:
            self._pass_time()
        self._keep()
        findings.told(octets, [*self._refused, *self._log.lines], wanted.wrong > 0, 1)
        asked = {_identity(each) for each in wanted.sound if each.split(b"|")[2] == self._asset}
        for report in self._heard.reports:
            if report.stage is Stage.ACCEPTED and report.identity not in asked:
                findings.add(Fault.UNCALLED, (octets, report.identity))
        for said in re.findall("[^#]*#?", "".join(self._wire.said))[:-1]:
            if not is_sound(said.encode("utf-8")):
                findings.add(Fault.CHANGED, said)
        if any(velocity != STANDING for velocity in self._rover.sent):
            findings.add(Fault.MOVED, octets)

    def close(self) -> None:
        self._executive.close()
        self._log.close()

    def _pass_time(self) -> None:
        self._clock.set(self._clock.now_s() + self._tick_s)
        self._executive.tick()
        self._wire.look()

    def _keep(self) -> None:
        """Keep all that was told, and what is told thereupon."""
        for said in self._wire.said:
            self._takers[UInt64](UInt64(data=fingerprint(said)))


def _identity(command: bytes) -> Identity:
    fields = command.split(b"|")
    return Identity(fields[1].decode(), int(fields[8] or 0))
