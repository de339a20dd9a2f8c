"""The bridge: a process of its own that attaches to NASA ION for the agent, and passes on bundles.

A process that dies within ION can leave the whole node locked, so this one does nothing else. It
ends with the agent or at its request, once ION has released it. Only the agent starts it.
"""

import logging
import os
import queue
import shutil
import signal
import socket
import subprocess
import sys
import threading
from argparse import ArgumentParser
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Final

from adapters.bundle.codec.eid import Ipn, parse_eid
from adapters.bundle.codec.errors import DecodeError
from adapters.bundle.daemons import ion_frames as frames

_NODE_LIST: Final = "ION_NODE_LIST_DIR"
_BP_VERSION: Final = "PYION_BP_VERSION"


_ADMIN: Final = "bpadmin"
_EXPEDITED: Final = 2
_SEGMENT: Final = "/SYSV"
_NOT_THERE: Final = ("database not found", "can't attach", "not initialized")
_POLL_S: Final = 1.0
_MAX_ANSWER_OCTETS: Final = 200
_LENGTH_OCTETS = 4
_LOG: Final = logging.getLogger(__name__)
_RETRY_S: Final = 1.0
_INTERRUPT_S: Final = 0.2
_SPACE_RETRY_S: Final = 1.0


class IonError(Exception):
    """ION cannot be used.

    Attributes:
        lasting: whether a restart of the bridge would fail for the same reason.
    """

    def __init__(self, text: str, *, lasting: bool = False) -> None:
        super().__init__(text)
        self.lasting = lasting


class IonEndpoint:
    """One ION endpoint; one thread sends, another receives.

    Raises:
        IonError: pyion is missing or too old, ION is not running, or lacks this endpoint.
    """

    def __init__(self, own: Ipn) -> None:
        os.environ.setdefault(_BP_VERSION, "BPv7")
        try:
            import pyion
            import pyion.utils
        except (ImportError, ValueError) as error:
            raise IonError(
                f"{sys.executable} cannot import pyion: {error}. Build the pyion of your ION for"
                " it, or name the interpreter that has it: ion: {python: PATH}",
                lasting=True,
            ) from error
        pyion.utils.ion_dir_lock = nullcontext()
        try:
            self._proxy: Any = pyion.get_bp_proxy(own.node)
            _change_to_node_folder(own.node)
            self._proxy.node_dir = None
            self._proxy.bp_attach()
            self._endpoint: Any = self._proxy.bp_open(str(own), mem_ctrl=True, return_headers=True)
        except TypeError as error:
            raise IonError(
                f"this pyion does not report the source of a bundle: {error}", lasting=True
            ) from error
        except (OSError, SystemError, RuntimeError) as error:
            raise IonError(str(error)) from error
        self._endpoint._lock = nullcontext()

    def receive(self) -> frames.Received:
        """Wait without limit for a bundle; this call deletes it in ION.

        Raises:
            IonError: interrupted, ION has ended, or another process has the endpoint open.
        """
        try:
            payload, headers = self._endpoint.bp_receive()
        except (OSError, RuntimeError, MemoryError) as error:
            raise IonError(
                f"cannot receive: {error}; ION has ended, or another process has the endpoint open"
            ) from error
        return frames.Received(
            headers["bundleSourceEid"],
            headers["bundleCreationTimeMsec"],
            headers["bundleCreationTimeCount"],
            payload,
        )

    def send(self, destination: str, lifetime_s: int, payload: bytes, expedited: bool) -> None:
        """Give a payload to ION; wait as long as ION is full.

        Raises:
            IonError: ION rejects it.
        """
        try:
            priority = _EXPEDITED if expedited else None
            self._endpoint.bp_send(destination, payload, TTL=lifetime_s, priority=priority)
        except (OSError, RuntimeError, MemoryError, ValueError) as error:
            raise IonError(f"ION: {error}") from error

    def interrupt(self) -> None:
        """End a waiting `receive`."""
        self._proxy.bp_interrupt_all()

    def close(self) -> None:
        """Close the endpoint and detach."""
        self._proxy.bp_close_all()
        self._proxy.bp_detach()


def _change_to_node_folder(node: int) -> None:
    """Change to the folder that identifies the node among the ION nodes of this machine."""
    if (folder := os.environ.get(_NODE_LIST)) is None:
        return
    try:
        os.chdir(Path(folder) / str(node))
    except OSError as error:
        raise IonError(f"{_NODE_LIST}: {error}") from error


class SharedMemory:
    """Segments of ION's shared memory attached to this process (Linux, System V).

    A restarted ION creates new segments. A process attached to the old ones gets no error: it waits
    for ever, and its bundles are lost.
    """

    def __init__(self) -> None:
        self._attached = self._of_this_process()

    def lost(self) -> bool:
        """Return whether an attached segment is no longer the one of its key."""
        return not self._attached <= self._of_all()

    @staticmethod
    def _of_this_process() -> frozenset[tuple[int, int]]:
        """Return (key, identifier) pairs; the kernel shows the identifier as the inode."""
        fields = (line.split() for line in _lines(Path("/proc/self/maps")))
        return frozenset(
            (int(mapped[5].removeprefix(_SEGMENT), 16), int(mapped[4]))
            for mapped in fields
            if len(mapped) > 5 and mapped[5].startswith(_SEGMENT)
        )

    @staticmethod
    def _of_all() -> frozenset[tuple[int, int]]:
        rows = (line.split() for line in _lines(Path("/proc/sysvipc/shm"))[1:])
        return frozenset((int(row[0]) & 0xFFFFFFFF, int(row[1])) for row in rows)


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text().splitlines()
    except OSError:
        return []


class Probe:
    """Checks whether the attached instance of ION still runs, and queries bpadmin.

    A bpadmin that hangs is awaited and never killed: a kill could leave a lock behind.

    Args:
        own: the endpoint.
        every_s: period of the bpadmin queries.
        answer_s: timeout of an answer.
        memory: attached segments, checked each second.
        on_lost: called on another thread when ION has ended or was restarted.

    Attributes:
        answers: whether ION answered the latest query; always true without bpadmin.
    """

    def __init__(
        self, own: str, every_s: float, answer_s: float, memory: SharedMemory,
        on_lost: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.answers = True
        self._own, self._question = own, f"i endpoint {own}\nq\n".encode("ascii")
        self._every_s, self._answer_s = every_s, answer_s
        self._memory, self._on_lost = memory, on_lost
        self._over = threading.Event()

    def start(self) -> None:
        """Start the checks, and the queries if bpadmin is on the PATH."""
        threading.Thread(target=self._poll_memory, daemon=True).start()
        if (program := shutil.which(_ADMIN)) is not None:
            threading.Thread(target=self._poll_daemon, args=(program,), daemon=True).start()

    def stop(self) -> None:
        """Stop checks and queries."""
        self._over.set()

    def _poll_memory(self) -> None:
        while not self._over.wait(min(_POLL_S, self._every_s)):
            if self._memory.lost():
                self._on_lost("ION was restarted, or its shared memory removed")
                return

    def _poll_daemon(self, program: str) -> None:
        while not self._over.wait(self._every_s):
            try:
                self._query_daemon(program)
            except OSError:
                self.answers = False

    def _query_daemon(self, program: str) -> None:
        query = subprocess.Popen(
            [program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        try:
            output, _ = query.communicate(self._question, self._answer_s)
        except subprocess.TimeoutExpired:
            self.answers = False
            output, _ = query.communicate()
        answer = output.decode("ascii", "replace")
        self.answers = self._own in answer
        if any(text in answer for text in _NOT_THERE):
            self._on_lost(f"ION is not running: {' '.join(answer.split())[:_MAX_ANSWER_OCTETS]}")


class Spool:
    """Stores one received unit in a file until the agent has stored it."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def load(self) -> frames.Received | None:
        """Return the unit that an earlier bridge left, or None.

        Raises:
            OSError: the file cannot be read.
        """
        try:
            frame = frames.decode_frame(self._path.read_bytes()[_LENGTH_OCTETS:])
        except (FileNotFoundError, DecodeError):
            return None
        return frame if isinstance(frame, frames.Received) else None

    def save(self, unit: frames.Received) -> None:
        """Write a unit to the disk.

        Raises:
            OSError: the file cannot be written.
        """
        beside = self._path.with_suffix(".new")
        with beside.open("wb") as file:
            file.write(frames.encode_frame(unit))
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self._path)
        folder = os.open(self._path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def clear(self) -> None:
        """Delete the stored unit."""
        self._path.unlink(missing_ok=True)


class Bridge:
    """Relays between the agent's frames and an ION endpoint, with a thread for each direction."""

    def __init__(
        self, channel: "BridgeSocket", endpoint: IonEndpoint, spool: Spool, probe: Probe,
        memory: SharedMemory,
    ) -> None:  # fmt: skip
        self._channel, self._endpoint, self._spool = channel, endpoint, spool
        self._probe, self._memory = probe, memory
        self._to_send: queue.PriorityQueue[tuple[bool, int, frames.SendRequest | None]]
        self._to_send = queue.PriorityQueue()
        self._acknowledged: queue.SimpleQueue[frames.ReceivedAck | None] = queue.SimpleQueue()
        self._over = threading.Event()

    def run(self) -> None:
        """Run until the agent disconnects, a signal arrives, or ION ends."""
        receiving = threading.Thread(target=self._receive, name="receive")
        sending = threading.Thread(target=self._send, name="send")
        self._channel.write(frames.Ready())
        self._probe.start()
        for thread in (receiving, sending):
            thread.start()
        try:
            for frame in self._channel.frames():
                self._receive_frame(frame)
        except DecodeError:
            _LOG.exception("malformed frame from the agent")
        self._over.set()
        self._probe.stop()
        self._to_send.put((False, 0, None))
        self._acknowledged.put(None)
        while receiving.is_alive():
            self._endpoint.interrupt()
            receiving.join(_INTERRUPT_S)
        sending.join(_SPACE_RETRY_S)
        self._endpoint.close()  # also ends a send that waits because ION is full
        sending.join()

    def _receive_frame(self, frame: frames.Frame) -> None:
        match frame:
            case frames.SendRequest():
                self._to_send.put((not frame.expedited, frame.number, frame))
            case frames.ReceivedAck():
                self._acknowledged.put(frame)
            case frames.Ping():
                self._channel.write(frames.Pong(self._probe.answers))
            case _:
                raise DecodeError(f"unexpected frame {type(frame).__name__} from the agent")

    def _send(self) -> None:
        while (frame := self._to_send.get()[2]) is not None and not self._over.is_set():
            try:
                self._endpoint.send(
                    frame.destination, frame.lifetime_s, frame.payload, frame.expedited
                )
                if self._memory.lost():
                    raise IonError("ION was restarted: the payload went into removed memory")
                self._channel.write(frames.Sent(frame.number))
            except IonError as error:
                self._channel.write(frames.SendRejected(frame.number, str(error)))

    def _receive(self) -> None:
        try:
            unit = self._spool.load()
            while not self._over.is_set():
                if unit is None:
                    unit = self._endpoint.receive()
                    self._save(unit)
                self._channel.write(unit)
                if (taken := self._acknowledged.get()) is None:
                    return
                if taken.stored:
                    self._spool.clear()
                    unit = None
                else:
                    self._over.wait(_RETRY_S)
        except (IonError, OSError) as error:
            if not self._over.is_set():
                self._channel.write(frames.Failed(str(error), lasting=False))
                self._channel.hang_up()

    def _save(self, unit: frames.Received) -> None:
        """Save a unit; if that fails the agent receives it nevertheless."""
        try:
            self._spool.save(unit)
        except OSError as error:
            _LOG.error("received unit not spooled before the agent stores it: %s", error)


class BridgeSocket:
    """Socket to the agent, written by several threads and read by one."""

    def __init__(self, connected: socket.socket) -> None:
        self._socket, self._lock = connected, threading.Lock()

    def write(self, frame: frames.Frame) -> None:
        """Send a frame; the reading thread notices a closed connection."""
        with self._lock:
            try:
                self._socket.sendall(frames.encode_frame(frame))
            except OSError:
                self.hang_up()

    def frames(self) -> Iterator[frames.Frame]:
        """Yield received frames until the socket is closed.

        Raises:
            DecodeError: the octets are not frames.
        """
        reader = frames.FrameReader()
        while octets := self._read():
            yield from reader.feed(octets)

    def hang_up(self) -> None:
        """End the reading; may be called from a signal handler."""
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
    line = ArgumentParser(
        "adapters.bundle.daemons.ion_bridge", description="Only the agent starts this process."
    )
    line.add_argument("--fd", type=int, required=True)
    line.add_argument("--own", required=True)
    line.add_argument("--spool", type=Path, required=True)
    line.add_argument("--look-s", type=float, required=True)
    line.add_argument("--answer-s", type=float, required=True)
    options = line.parse_args()
    logging.basicConfig(level="INFO", format="%(levelname)-7s ION bridge: %(message)s")
    own = parse_eid(options.own)
    channel = BridgeSocket(socket.socket(fileno=options.fd))
    _install_signals(channel)
    try:
        if not isinstance(own, Ipn):
            raise IonError(f"ION has only ipn endpoints, not {own}", lasting=True)
        endpoint = IonEndpoint(own)
    except IonError as error:
        channel.write(frames.Failed(str(error), error.lasting))
        sys.exit(1)
    _install_signals(channel)  # pyion has replaced the handler of SIGINT
    memory = SharedMemory()

    def leave(why: str) -> None:
        """Exit at once: nothing in ION is locked, and a call into lost memory never returns."""
        channel.write(frames.Failed(why, lasting=False))
        os._exit(1)

    probe = Probe(options.own, options.look_s, options.answer_s, memory, leave)
    Bridge(channel, endpoint, Spool(options.spool), probe, memory).run()


def _install_signals(channel: BridgeSocket) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: channel.hang_up())


if __name__ == "__main__":
    main()
