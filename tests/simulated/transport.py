"""The transport of asyncio over one end of a simulated TCP connection."""

import asyncio
from collections import deque
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tests.simulated.loop import SimLoop
    from tests.simulated.streams import StreamSocket

_READ_AT_ONCE: Final = 256 << 10
_HIGH_OCTETS: Final = 64 << 10


class SimTransport(asyncio.Transport):
    """Reads and writes as asyncio's own transport does, one read an event.

    Args:
        loop: of its protocol.
        stream: its end of the connection.
        protocol: which is told of the connection as the next event.
        begun: is done then.
    """

    def __init__(
        self,
        loop: "SimLoop",
        stream: "StreamSocket",
        protocol: asyncio.BaseProtocol,
        begun: asyncio.Future[None] | None = None,
    ) -> None:
        extra = {
            "socket": stream,
            "sockname": stream.getsockname(),
            "peername": stream.getpeername(),
        }
        super().__init__(extra)
        self._loop = loop
        self._paused = False
        self.set_write_buffer_limits()
        self._stream, self._begun = stream, begun
        self.set_protocol(protocol)
        self._waiting: deque[bytes] = deque()
        self._waiting_octets = 0
        self._reading = self._reads = self._closing = self._lost = self._finishing = False
        stream.transport = self
        loop.call_soon(self._begin)

    def set_protocol(self, protocol: asyncio.BaseProtocol) -> None:
        self._protocol = protocol
        self._buffered = isinstance(protocol, asyncio.BufferedProtocol)

    def get_protocol(self) -> asyncio.BaseProtocol:
        return self._protocol

    def is_closing(self) -> bool:
        return self._closing

    def is_reading(self) -> bool:
        return self._reading and not self._closing

    def pause_reading(self) -> None:
        self._reading = False

    def resume_reading(self) -> None:
        if not self._closing:
            self._reading = True
            self.readable()

    def get_write_buffer_size(self) -> int:
        return self._waiting_octets

    def get_write_buffer_limits(self) -> tuple[int, int]:
        return self._low_octets, self._high_octets

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        if high is None:
            high = _HIGH_OCTETS if low is None else 4 * low
        self._high_octets, self._low_octets = high, high // 4 if low is None else low

    def write(self, data: Any) -> None:
        octets = bytes(data)
        if not octets or self._lost or self._stream.fault is not None:
            return
        if self._finishing:
            raise RuntimeError("Cannot call write() after write_eof()")
        if not self._waiting:
            package = self._stream.capacity
            if len(octets) <= package:
                self._stream.send(octets)
                return
            if package > 0:
                self._stream.send(octets[:package])
                octets = octets[package:]
        self._waiting.append(octets)
        self._waiting_octets += len(octets)
        self._stream.await_space()
        if self._waiting_octets > self._high_octets and not self._paused:
            self._paused = True
            self._protocol.pause_writing()

    def writelines(self, list_of_data: Any) -> None:
        self.write(b"".join(list_of_data))

    def can_write_eof(self) -> bool:
        return True

    def write_eof(self) -> None:
        if not self._finishing and not self._closing:
            self._finishing = True
            if not self._waiting:
                self._stream.finish()

    def close(self) -> None:
        if self._closing:
            return
        self._closing = True
        if not self._waiting:
            self._lose(None)

    def abort(self) -> None:
        self._waiting.clear()
        self._waiting_octets = 0
        self._closing = True
        self._lose(None)

    @property
    def waits_for_space(self) -> bool:
        """Whether octets were written that are not sent yet."""
        return bool(self._waiting)

    def flush(self) -> None:
        """Send what there is room for."""
        if self._lost:
            return
        waiting, stream = self._waiting, self._stream
        while waiting and (package := stream.capacity) > 0:
            octets = waiting.popleft()
            if len(octets) > package:
                waiting.appendleft(octets[package:])
                octets = octets[:package]
            self._waiting_octets -= len(octets)
            stream.send(octets)
        if waiting:
            stream.await_space()
        elif self._closing:
            self._lose(None)
        elif self._finishing:
            stream.finish()
        if self._paused and self._waiting_octets <= self._low_octets:
            self._loop.call_soon(self._resume_writing)

    def readable(self) -> None:
        """Have what has arrived read, in an event of its own."""
        stream = self._stream
        if self._reads or self._lost or not stream.readable:
            return
        if stream.fault is not None or (self._reading and not self._closing):
            self._reads = True
            self._loop.call_soon(self._read)

    def _resume_writing(self) -> None:
        if self._paused and not self._lost and self._waiting_octets <= self._low_octets:
            self._paused = False
            self._protocol.resume_writing()

    def _begin(self) -> None:
        begun = self._begun
        self._reading = True
        try:
            self._protocol.connection_made(self)
        finally:
            if begun is not None and not begun.done():
                begun.set_result(None)
            self.readable()

    def _read(self) -> None:
        self._reads = False
        stream = self._stream
        if self._lost:
            return
        if stream.fault is not None:
            self._closing = True
            self._waiting.clear()
            self._waiting_octets = 0
            self._lose(stream.fault)
            return
        if not self._reading or self._closing:
            return
        try:
            self._read_some()
        except Exception as fault:
            self._loop.call_exception_handler(
                {
                    "message": "Fatal error: the protocol's reading failed.",
                    "exception": fault,
                    "transport": self,
                    "protocol": self._protocol,
                }
            )
            self._closing = True
            self._lose(fault)
        else:
            self.readable()

    def _read_some(self) -> None:
        stream, protocol = self._stream, self._protocol
        if self._buffered:
            assert isinstance(protocol, asyncio.BufferedProtocol)
            buffer = memoryview(protocol.get_buffer(-1))
            octets = stream.take(len(buffer))
            if octets:
                buffer[: len(octets)] = octets
                protocol.buffer_updated(len(octets))
                return
        else:
            assert isinstance(protocol, asyncio.Protocol)
            octets = stream.take(_READ_AT_ONCE)
            if octets:
                protocol.data_received(octets)
                return
        stream.ended = False
        if protocol.eof_received():
            self._reading = False
        else:
            self.close()

    def _lose(self, fault: Exception | None) -> None:
        if not self._lost:
            self._lost = True
            self._loop.call_soon(self._notify_lost, fault)

    def _notify_lost(self, fault: Exception | None) -> None:
        try:
            self._protocol.connection_lost(fault)
        finally:
            self._stream.close()
