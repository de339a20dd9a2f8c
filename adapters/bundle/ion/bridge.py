"""The bridge: the process that is attached to ION, so that the agent is not.

Who dies within ION can leave the whole node locked; so this process does nothing else, ends when
the agent does or asks for it, and only once ION has let go of it. Started by the agent alone.
"""

import logging
import queue
import signal
import socket
import sys
import threading
from argparse import ArgumentParser
from collections.abc import Iterator
from pathlib import Path
from typing import Final, assert_never

from adapters.bundle.eid import Ipn, parse_eid
from adapters.bundle.errors import DecodeError
from adapters.bundle.ion.endpoint import IonEndpoint, IonFault
from adapters.bundle.ion.frames import (
    Failed,
    Frame,
    FrameReader,
    Ping,
    Pong,
    Ready,
    Received,
    Refused,
    Send,
    Sent,
    Taken,
    encode_frame,
)
from adapters.bundle.ion.probe import Probe
from adapters.bundle.ion.spool import Spool

_LOG: Final = logging.getLogger(__name__)
_AGAIN_S: Final = 1.0
_INTERRUPT_S: Final = 0.2
_ROOM_S: Final = 1.0


class Bridge:
    """Frames on the one side, an endpoint of ION on the other, a thread for each way.

    Args:
        channel: to the agent.
        endpoint: of ION.
        spool: keeps what was received until the agent has it.
        probe: knows whether ION answers.
    """

    def __init__(
        self, channel: "Channel", endpoint: IonEndpoint, spool: Spool, probe: Probe
    ) -> None:
        """Prepare; see `run`."""
        self._channel, self._endpoint, self._spool = channel, endpoint, spool
        self._probe = probe
        self._to_send: queue.SimpleQueue[Send | None] = queue.SimpleQueue()
        self._taken: queue.SimpleQueue[Taken | None] = queue.SimpleQueue()
        self._over = threading.Event()

    def run(self) -> None:
        """Work until the agent hangs up, a signal comes, or ION ends."""
        receiving = threading.Thread(target=self._receive, name="receive")
        sending = threading.Thread(target=self._send, name="send")
        self._channel.write(Ready())
        self._probe.start()
        for thread in (receiving, sending):
            thread.start()
        try:
            for frame in self._channel.frames():
                self._heed(frame)
        except DecodeError:
            _LOG.exception("the agent makes no sense")
        self._over.set()
        self._probe.stop()
        self._to_send.put(None)
        self._taken.put(None)
        while receiving.is_alive():
            self._endpoint.interrupt()
            receiving.join(_INTERRUPT_S)
        sending.join(_ROOM_S)
        self._endpoint.close()  # ends, too, a sending that waits for room
        sending.join()

    def _heed(self, frame: Frame) -> None:
        match frame:
            case Send():
                self._to_send.put(frame)
            case Taken():
                self._taken.put(frame)
            case Ping():
                self._channel.write(Pong(self._probe.answers))
            case Ready() | Sent() | Refused() | Received() | Pong() | Failed():
                raise DecodeError(f"{type(frame).__name__} is for the agent")
            case _:
                assert_never(frame)

    def _send(self) -> None:
        while (frame := self._to_send.get()) is not None and not self._over.is_set():
            try:
                self._endpoint.send(frame.destination, frame.lifetime_s, frame.payload)
                self._channel.write(Sent(frame.number))
            except IonFault as fault:
                self._channel.write(Refused(frame.number, str(fault)))

    def _receive(self) -> None:
        try:
            unit = self._spool.load()
            while not self._over.is_set():
                if unit is None:
                    unit = self._endpoint.receive()
                    self._save(unit)
                self._channel.write(unit)
                if (taken := self._taken.get()) is None:
                    return
                if taken.kept:
                    self._spool.clear()
                    unit = None
                else:
                    self._over.wait(_AGAIN_S)
        except (IonFault, OSError) as fault:
            if not self._over.is_set():
                self._channel.write(Failed(str(fault), lasting=False))
                self._channel.hang_up()

    def _save(self, unit: Received) -> None:
        """Save a unit; a disk that is full does not keep it from the agent."""
        try:
            self._spool.save(unit)
        except OSError as error:
            _LOG.error("not saved before the agent has it: %s", error)


class Channel:
    """The socket to the agent, written by many threads and read by one."""

    def __init__(self, connected: socket.socket) -> None:
        """Use a connected socket."""
        self._socket, self._lock = connected, threading.Lock()

    def write(self, frame: Frame) -> None:
        """Send a frame; an agent that is gone is noticed by who reads."""
        with self._lock:
            try:
                self._socket.sendall(encode_frame(frame))
            except OSError:
                self.hang_up()

    def frames(self) -> Iterator[Frame]:
        """Return what comes, until somebody hangs up.

        Raises:
            DecodeError: it makes no sense.
        """
        reader = FrameReader()
        while octets := self._read():
            yield from reader.feed(octets)

    def hang_up(self) -> None:
        """Have the reading end; may be called by a signal."""
        try:
            self._socket.shutdown(socket.SHUT_RD)
        except OSError:
            return

    def _read(self) -> bytes:
        try:
            return self._socket.recv(65_536)
        except OSError:
            return b""


def main() -> None:
    """Serve one agent at a socket that it has opened."""
    line = ArgumentParser("adapters.bundle.ion.bridge", description="Started by the agent alone.")
    line.add_argument("--fd", type=int, required=True)
    line.add_argument("--own", required=True)
    line.add_argument("--spool", type=Path, required=True)
    line.add_argument("--look-s", type=float, required=True)
    line.add_argument("--answer-s", type=float, required=True)
    options = line.parse_args()
    logging.basicConfig(level="INFO", format="%(levelname)-7s ION bridge: %(message)s")
    own = parse_eid(options.own)
    channel = Channel(socket.socket(fileno=options.fd))
    _heed_signals(channel)
    try:
        if not isinstance(own, Ipn):
            raise IonFault(f"ION takes ipn endpoints, not {own}", lasting=True)
        endpoint = IonEndpoint(own)
    except IonFault as fault:
        channel.write(Failed(str(fault), fault.lasting))
        sys.exit(1)
    _heed_signals(channel)  # pyion has taken SIGINT for itself
    probe = Probe(options.own, options.look_s, options.answer_s)
    Bridge(channel, endpoint, Spool(options.spool), probe).run()


def _heed_signals(channel: Channel) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: channel.hang_up())


if __name__ == "__main__":
    main()
