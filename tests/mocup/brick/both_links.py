"""MOCUP's two links on one desk: the real router, record, plugin and claims; the rest is modelled.

What a real system loses when one of its processes is killed is lost here as well: what was on its
way to or from it, and what was said before ROS had found who hears whom.
"""

import sqlite3
from collections import Counter, defaultdict, deque
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import RESTARTED, Router
from adapters.mocup.brick.service import DurableOutput
from adapters.mocup.plugin import RETRANSMIT_S
from adapters.mops import Message, RelayAuthority, decode, encode, is_last
from executive.values.clock import ManualClock
from executive.values.reports import Identity
from tests.mocup.brick.models import DICTIONARY, SETTINGS, STOP, Brick, Executive, request
from tests.support.unsynced import UNSYNCED, Unsynced

FREE = RelayAuthority(needed=False)


class Killed(BaseException):
    """Here ends rover-nxt."""


class Fuse:
    """Kills after so many things were done."""

    left = 0

    def __call__(self) -> None:
        self.left -= 1
        if self.left == 0:
            raise Killed


class Fused:
    """A record whose user may be killed before and after each call of it."""

    def __init__(self, record: BrickRecord, fuse: Fuse) -> None:
        self._record, self._fuse = record, fuse

    def __getattr__(self, name: str) -> Any:
        def call(*arguments: Any, **named: Any) -> Any:
            self._fuse()
            returned = getattr(self._record, name)(*arguments, **named)
            self._fuse()
            return returned

        return call


class Saved(Unsynced):
    """A computer with a record on its disk as it was synced."""

    def __init__(self, image: bytes) -> None:
        self._image = image

    def connect(self, database: Path | str, *, any_thread: bool = False) -> sqlite3.Connection:
        connection = super().connect(database, any_thread=any_thread)
        connection.deserialize(self._image)
        return connection


class Desk:
    """Everything together. It is the router's ports, too."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.brick, self.plugged = Brick(), True
        self.executive = Executive(self.clock)
        self.fuse = Fuse()
        self.usb: deque[Message] = deque()
        self.notes: dict[BrickLink, deque[Message]] = {link: deque() for link in BrickLink}
        self.found = dict.fromkeys(BrickLink, False)
        self.relay_sent: dict[int, Message] = {}
        self.relay_received: defaultdict[int, list[Message]] = defaultdict(list)
        self.record = BrickRecord(system=UNSYNCED)
        self._synced = self.record.image()
        self.start_nxt()

    def to_brick(self, octets: bytes, visit: int) -> bool:
        assert visit == 1 or not self.plugged
        self._check_turn(decode(octets))
        self.fuse()
        if self.plugged:
            self.output.sync()
            self.held.append((self.record.sealed, decode(octets)))
            self._release()
        self.fuse()
        return self.plugged

    def stop_brick(self, octets: bytes) -> bool:
        self.fuse()
        if self.plugged:
            self.held.clear()
            self.usb.append(decode(octets))
        self.fuse()
        return self.plugged

    def notify(self, link: BrickLink, message: Message) -> None:
        self.output.put(link, message)

    def _put(self, link: BrickLink, message: Message | int) -> None:
        assert isinstance(message, Message)
        self.fuse()
        if self.found[link]:
            self.notes[link].append(message)
        self.fuse()

    def _start_sync(self) -> None:
        self.syncing = True

    def sync(self) -> None:
        """Let a sync end that was begun."""
        if self.syncing:
            self.syncing = False
            self._synced = self.record.image()
            self.record.sync()
            self._release()
            self.killed(self.output.on_synced, None)

    def _release(self) -> None:
        while self.held and self.held[0][0] <= self.record.durable:
            self.usb.append(self.held.popleft()[1])

    def cut_power(self) -> None:
        """Lose all that was not synced, and the processes aboard."""
        self.record.close()
        self.record = BrickRecord(system=Saved(self._synced))
        self.start_executive()
        self.start_nxt()

    def publish_telemetry(self, message: Message) -> None:
        raise AssertionError(message)

    def start_nxt(self) -> None:
        """Begin a process of rover-nxt, maybe after another that was killed."""
        self.fuse.left = 0
        for _ in range((len(self.usb) + 1) // 2):
            self.usb_in()
        self.usb.clear()
        self.held: deque[tuple[int, Message]] = deque()
        self.syncing = False
        self.brick.output.clear()
        self.executive.out.clear()
        self.executive.receives = False
        self.found = dict.fromkeys(BrickLink, False)
        refused: list[str] = []
        record = cast(BrickRecord, Fused(self.record, self.fuse))
        self.output = DurableOutput(self.record, STOP, self._put, self._start_sync, refused.append)
        self.router = Router(DICTIONARY, "MOCUP", self, refused.append, record, FREE, self.clock)
        self.router.on_disconnected(RESTARTED)
        if self.plugged:
            self.router.on_connected(1)

    def start_executive(self) -> None:
        self.notes[BrickLink.DIRECT].clear()
        self.found[BrickLink.DIRECT] = False
        self.executive.start()

    def start_relay(self) -> None:
        self.notes[BrickLink.RELAY].clear()
        self.found[BrickLink.RELAY] = False

    def killed(self, act: Any, *arguments: Any) -> None:
        """Do something to rover-nxt, which may be killed by it."""
        try:
            act(*arguments)
        except Killed:
            self.start_nxt()

    def discover(self) -> None:
        """ROS finds who hears whom."""
        if not self.executive.receives:
            self.executive.receives = True
            self.executive.again()
        for link in BrickLink:
            if not self.found[link]:
                self.found[link] = True
                self.killed(self.router.resend_last, link)

    def plug(self, plugged: bool) -> None:
        """Have the brick there or not."""
        self.plugged = plugged
        if plugged:
            self.killed(self.router.on_connected, 1)
        else:
            self.usb.clear()
            self.held.clear()
            self.brick.output.clear()
            self.brick.task = None
            self.killed(self._lose_brick)

    def direct(self) -> None:
        """Pass one message of the executive on."""
        if self.executive.out:
            message = self.executive.out.popleft()
            if self.executive.receives:
                self._to_router(BrickLink.DIRECT, message)

    def relay(self, number: int, counter: int | None) -> None:
        identity = Identity("MOE", number)
        copy = replace(
            DICTIONARY.command(request(number), identity, "MOCUP"), moe_inputs_counter=counter
        )
        self.relay_sent[number] = copy
        self._to_router(BrickLink.RELAY, copy)

    def retransmit(self) -> None:
        """Do what the orbiter does about commands on which nothing was said."""
        for number, copy in self.relay_sent.items():
            if not self.relay_received[number]:
                self._to_router(BrickLink.RELAY, copy)

    def deliver(self, link: BrickLink) -> None:
        if self.notes[link]:
            message = self.notes[link].popleft()
            if link is BrickLink.DIRECT:
                self.executive.receive(message)
            elif message.moe_inputs_id is not None and message.dest == "MOE":
                self.relay_received[message.moe_inputs_id].append(message)

    def usb_in(self) -> None:
        """Pass one message on to the brick."""
        if self.usb:
            self.brick.receive(self.usb.popleft())

    def usb_out(self) -> None:
        """Pass one message of the brick on."""
        if self.brick.output:
            text = self.brick.output.popleft()
            if self.plugged:
                self.killed(self.router.on_octets, encode(text))

    def settle(self) -> None:
        """Let everything come to its end, with nobody killed any more."""
        self.fuse.left = 0
        if not self.plugged:
            self.plug(True)
        for _ in range(25):
            self.discover()
            self.clock.advance(RETRANSMIT_S)
            self.executive.tick()
            self.router.poll()
            while (
                *self.executive.out,
                *self.usb,
                *self.brick.output,
                *filter(None, [*self.notes.values(), self.syncing]),
            ):
                self.sync()
                self.direct()
                self.usb_in()
                self.usb_out()
                self.deliver(BrickLink.DIRECT)
                self.deliver(BrickLink.RELAY)
            self.brick.end()

    def _lose_brick(self) -> None:
        self.router.on_disconnected()
        assert self.record.waiting() == []

    def _to_router(self, link: BrickLink, message: Message) -> None:
        stops = message.code == STOP and not message.received and not message.outputs
        waiting = len(self.usb)
        try:
            self.router.process(link, str(message))
        except Killed:
            self.start_nxt()
        else:
            if stops:
                assert self.record.waiting() == []
                assert [e.code for e in self.usb][waiting:] == ([STOP] if self.plugged else [])

    def _check_turn(self, message: Message) -> None:
        """The relay's commands are sent when the brick has nothing else to do."""
        requested = self.record.find(message)
        if message.code != STOP and requested is not None and requested.links == (BrickLink.RELAY,):
            assert [each.command for each in self.record.unanswered()] == [message]

    def check_once(self) -> None:
        """No motion of a command was begun twice, nor both whole and in parts."""
        begun = [m for m in self.brick.begun if m.source == "MOE" and m.code not in SETTINGS]
        seen = Counter((m.moe_inputs_id, m.code, m.inputs) for m in begun)
        assert max(seen.values(), default=0) <= 1, seen
        codes: defaultdict[int | None, set[str]] = defaultdict(set)
        for message in begun:
            codes[message.moe_inputs_id].add(message.command)
        for number, commands in codes.items():
            assert "MOVE_TO" not in commands or len(commands) == 1, (number, commands)

    def outcomes(self, number: int) -> set[str]:
        """What the relay heard at the end of what was taken in."""
        return {
            text.outputs[0]
            for text in self.relay_received[number]
            if is_last(text) and text.outputs[0] != "REJECTED"
        }
