"""While the disk of rover-nxt syncs, a stop and heartbeats reach the brick; a command waits."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import pytest
from rclpy.publisher import Publisher
from std_msgs.msg import String, UInt64

from adapters.mocup.brick.node import NxtNode, declare_settings
from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.usb import Brick
from adapters.mops import Message, MopsStream, decode, fingerprint
from adapters.ros import Topic, declare_topics, publish_heartbeat, ros_node, single_threaded
from executive.settings import config_folder
from tests.mocup.brick.bus import ADDRESS, Bus
from tests.mocup.brick.routing import SPELLING, STOP, forward, stop
from tests.support.unsynced import HeldDisk

pytestmark = pytest.mark.ros

LIMIT_S = 60.0
BEATS = 12
"""Heartbeats of the brick in more time than the owner's watchdog allows."""


class Bench:
    """The node of rover-nxt on a disk that can be held, and its links on the same node."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.disk, self._bus = HeldDisk(), Bus()
        self.notified: list[BrickLink] = []
        self.acknowledged: set[int] = set()
        config = config_folder()
        self.record = stack.enter_context(closing(BrickRecord(folder / "nxt.sqlite", self.disk)))
        self._node = stack.enter_context(
            ros_node(
                "nxt",
                "mocup",
                parameters=config / "mocup.ros.yaml",
                ros_arguments=("--params-file", str(config / "mocup.nxt.yaml")),
            )
        )
        self._executor = stack.enter_context(single_threaded(self._node))
        settings, topics = declare_settings(self._node), declare_topics(self._node)
        nxt = NxtNode(self._node, topics, settings, self.record, lambda: Brick(ADDRESS, self._bus))
        stack.enter_context(closing(nxt))
        stack.callback(self.disk.free.set)
        for link in BrickLink:
            publish_heartbeat(self._node, settings.commands[link])
            self._receive(settings.notifications[link], partial(self._on_notification, link))
            self._receive(settings.acknowledgements[link], self._on_acknowledged)
        self.direct = self._publisher(settings.commands[BrickLink.DIRECT])
        self.stops = self._publisher(settings.stops)
        self.until_beaten(1)
        self.until(lambda: self.record.durable == self.record.sealed, "a first sync")
        self.notified.clear()

    def until(self, done: Callable[[], bool], what: str) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not done():
            assert time.monotonic() < deadline_s, f"waited in vain: {what}; {self.sent()}"
            self._executor.spin_once(timeout_sec=0.01)

    def until_beaten(self, times: int) -> None:
        before = len(self._bus.written)
        self.until(lambda: len(self._bus.written) >= before + times, "heartbeats")

    def until_recorded(self, command: Message) -> None:
        self.until(lambda: self.record.find(command) is not None, str(command))

    def sent(self) -> list[tuple[int, int | None]]:
        """Return codes and numbers of the brick's messages, except heartbeats."""
        received = MopsStream(pytest.fail).feed(b"".join(self._bus.written))
        beat = SPELLING.keep_alive.code
        return [(each.code, each.moe_inputs_id) for each in received if each.code != beat]

    def _receive(self, topic: Topic, callback: Callable[..., None]) -> None:
        self._node.create_subscription(topic.type, topic.name, callback, topic.qos)

    def _publisher(self, topic: Topic) -> Publisher:
        made = self._node.create_publisher(topic.type, topic.name, topic.qos)
        self.until(lambda: made.get_subscription_count() > 0, f"{topic.name} is received")
        return made

    def _on_notification(self, link: BrickLink, text: String) -> None:
        if decode(text.data.encode()).code != SPELLING.housekeeping.code:
            self.notified.append(link)

    def _on_acknowledged(self, mark: UInt64) -> None:
        self.acknowledged.add(mark.data)


@pytest.fixture
def nxt(tmp_path: Path) -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack, tmp_path)


def test_a_stop_and_heartbeats_pass_while_the_disk_syncs(nxt: Bench) -> None:
    dropped, stopping, executed = forward(1), stop(2), forward(3)
    nxt.disk.free.clear()
    nxt.direct.publish(String(data=str(dropped)))
    nxt.until_recorded(dropped)
    nxt.until_beaten(BEATS)
    assert (nxt.sent(), nxt.notified, nxt.acknowledged) == ([], [], set())
    nxt.stops.publish(String(data=str(stopping)))
    nxt.until(
        lambda: bool(nxt.sent() and nxt.notified), "the stop, and the executive's notice of it"
    )
    assert (nxt.sent(), nxt.notified) == ([(STOP.code, 2)], [BrickLink.DIRECT])
    nxt.direct.publish(String(data=str(executed)))
    nxt.until_recorded(executed)
    assert (len(nxt.sent()), nxt.acknowledged) == (1, set())
    nxt.disk.free.set()
    marks = {fingerprint(str(each)) for each in (dropped, stopping, executed)}
    nxt.until(lambda: len(nxt.sent()) > 1 and nxt.acknowledged == marks, "the other command")
    nxt.until_beaten(1)
    assert nxt.sent() == [(STOP.code, 2), (executed.code, 3)]
