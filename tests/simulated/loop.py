"""An event loop on simulated time: a thread of a simulated process."""

# Its signatures are those that the product uses, narrower than asyncio's.
# mypy: disable-error-code="override"

import asyncio
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from contextvars import Context
from typing import TYPE_CHECKING, Any, Final, cast
from weakref import WeakSet

from tests.simulated.connecting import connect, transport_of
from tests.simulated.listening import Server

if TYPE_CHECKING:
    from tests.simulated.datagrams import DatagramSocket
    from tests.simulated.listening import Listener
    from tests.simulated.process import Incarnation
    from tests.simulated.streams import StreamSocket

_ANY: Final = "0.0.0.0"
_MAX_WAITS: Final = 1000
"""How often the end of a coroutine may wait when it is closed."""


class _Task(asyncio.Task[Any]):
    """Has a hash that repeats: a TaskGroup cancels its tasks in the order of a set."""

    def __init__(self, number: int, coro: Any, **options: Any) -> None:
        self._number = number
        super().__init__(coro, **options)

    def __hash__(self) -> int:
        return self._number


class SimLoop(asyncio.BaseEventLoop):
    """What asyncio offers of a loop, as far as the product uses it, on the heap of a world.

    Nothing is run by the loop itself: `World.run` does it.

    Args:
        incarnation: the process.
    """

    def __init__(self, incarnation: "Incarnation") -> None:
        self.incarnation, self.world = incarnation, incarnation.world
        self._tasks: WeakSet[asyncio.Task[Any]] = WeakSet()
        self._signals: dict[int, asyncio.Handle] = {}
        self._handed_s = 0.0
        self._working_s: dict[Any, float] = {}
        super().__init__()

    def __del__(self) -> None:
        """Say nothing of not being closed."""

    def time(self) -> float:
        return self.world.now_s

    def is_running(self) -> bool:
        return self.incarnation.alive

    def is_closed(self) -> bool:
        return False

    def run_forever(self) -> None:
        raise RuntimeError("World.run runs this loop")

    def stop(self) -> None:
        raise RuntimeError("Process.exit ends a simulated process")

    def call_soon(
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        handle = asyncio.Handle(callback, args, self, context)
        incarnation = self.incarnation
        if incarnation.alive:
            world = self.world
            world.push(world.now_s, incarnation, self, handle)
        return handle

    def call_at(
        self,
        when: float,
        callback: Callable[..., object],
        *args: Any,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        handle = asyncio.TimerHandle(when, callback, args, self, context)
        incarnation = self.incarnation
        if incarnation.alive:
            world = self.world
            world.push(when if when > world.now_s else world.now_s, incarnation, self, handle)
            handle._scheduled = True  # type: ignore[attr-defined]
        return handle

    def call_later(
        self,
        delay: float,
        callback: Callable[..., object],
        *args: Any,
        context: Context | None = None,
    ) -> asyncio.TimerHandle:
        return self.call_at(self.world.now_s + delay, callback, *args, context=context)

    def call_soon_threadsafe(
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        handle = asyncio.Handle(callback, args, self, context)
        # What is handed over keeps its order.
        now_s = self.world.now_s
        self._handed_s = max(self._handed_s, now_s + self.world.thread_delay_s())
        self.incarnation.push(self._handed_s - now_s, self, handle)
        return handle

    def create_task(self, coro: Any, **options: Any) -> asyncio.Task[Any]:
        task = _Task(self.world.next_task(), coro, loop=self, **options)
        self._tasks.add(task)
        if not self.incarnation.alive:
            self.incarnation.stored.append([task])
        return task

    def run_in_executor(
        self, executor: Any, func: Callable[..., Any], *args: Any
    ) -> asyncio.Future[Any]:
        done: asyncio.Future[Any] = self.create_future()

        def work() -> None:
            try:
                result = func(*args)
            except Exception as fault:
                self.call_soon_threadsafe(_settle, done, None, fault)
            else:
                self.call_soon_threadsafe(_settle, done, result, None)

        # In a thread of its own, which has no loop; a given executor has one, and a queue.
        at_s = self.world.now_s + self.world.thread_delay_s()
        if executor is not None:
            at_s = self._working_s[executor] = max(at_s, self._working_s.get(executor, 0.0))
        if self.incarnation.alive:
            self.world.push(at_s, self.incarnation, None, asyncio.Handle(work, (), self))
        return done

    async def shutdown_default_executor(self, timeout: float | None = None) -> None:
        return None

    def call_exception_handler(self, context: dict[str, Any]) -> None:
        if not self.incarnation.alive:
            return
        if self._exception_handler is not None:  # type: ignore[attr-defined]
            self._exception_handler(self, context)  # type: ignore[attr-defined]
            return
        self.world.fault(
            self.incarnation.process.name, str(context.get("message")), context.get("exception")
        )

    def add_signal_handler(self, sig: int, callback: Callable[..., object], *args: Any) -> None:
        self._signals[sig] = asyncio.Handle(callback, args, self, None)

    def remove_signal_handler(self, sig: int) -> bool:
        return self._signals.pop(sig, None) is not None

    def signalled(self, number: signal.Signals) -> bool:
        """Have the handler of a signal called; return whether there is one."""
        if (handler := self._signals.get(number)) is None:
            return False
        self.incarnation.push(self.world.thread_delay_s(), self, handler)
        return True

    async def getaddrinfo(
        self,
        host: str | None,
        port: Any,
        *,
        family: int = 0,
        type: int = 0,
        proto: int = 0,
        flags: int = 0,
    ) -> list[Any]:
        if host is not None and host not in ("", "localhost"):
            flags |= socket.AI_NUMERICHOST
        if host in (None, "", "localhost"):
            host = _ANY if flags & socket.AI_PASSIVE else "127.0.0.1"
        return socket.getaddrinfo(host, port, family, type, proto, flags)

    async def create_connection(
        self,
        protocol_factory: Callable[[], asyncio.BaseProtocol],
        host: str | None = None,
        port: int | None = None,
        *,
        ssl: object = None,
        sock: "StreamSocket | None" = None,
        **_: Any,
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        _no_tls(ssl)
        if sock is None:
            found = await self.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            sock = await connect(self, found[0][4][:2])
        return await transport_of(self, protocol_factory(), sock)

    async def create_server(
        self,
        protocol_factory: Callable[[], asyncio.BaseProtocol],
        host: str | None = None,
        port: int | None = None,
        *,
        sock: "Listener | None" = None,
        ssl: object = None,
        start_serving: bool = True,
        **_: Any,
    ) -> Server:
        _no_tls(ssl)
        if sock is None:
            network = self.incarnation.world.network
            sock = network.listen(self.incarnation, (host or _ANY, port or 0))
        server = Server(self, protocol_factory, sock)
        if start_serving:
            await server.start_serving()
        return server

    async def sock_accept(
        self, sock: "Listener | socket.socket"
    ) -> tuple["StreamSocket", tuple[str, int]]:
        accepted = await cast("Listener", sock).accept(self)
        return accepted, accepted.getpeername()

    async def sock_connect(self, sock: "StreamSocket", address: tuple[str, int]) -> None:
        sock.become(await connect(self, address[:2]))

    async def connect_accepted_socket(
        self,
        protocol_factory: Callable[[], asyncio.BaseProtocol],
        sock: "StreamSocket | socket.socket",
        *,
        ssl: object = None,
        **_: Any,
    ) -> tuple[asyncio.Transport, asyncio.BaseProtocol]:
        _no_tls(ssl)
        return await transport_of(self, protocol_factory(), cast("StreamSocket", sock))

    def add_reader(self, fd: Any, callback: Callable[..., object], *args: Any) -> None:
        cast("DatagramSocket", fd).watch(self, callback, args)

    def remove_reader(self, fd: Any) -> bool:
        return cast("DatagramSocket", fd).unwatch()

    def unfinished(self) -> list[Any]:
        """Return its tasks and asynchronous generators that have not ended."""
        tasks = [task for task in self._tasks if not task.done()]
        return [*tasks, *self._asyncgens]  # type: ignore[attr-defined]

    def free(self) -> None:
        """Close the coroutines of a dead process: what they do then reaches nothing."""
        stored = [each for some in self.incarnation.stored for each in some]
        for each in stored:
            if isinstance(each, asyncio.Task) and each.get_loop() is self and not each.done():
                each._log_destroy_pending = False  # type: ignore[attr-defined]
                _close(each.get_coro())

    def _timer_handle_cancelled(self, handle: asyncio.TimerHandle) -> None:
        self.world.timer_cancelled()

    def _asyncgen_firstiter_hook(self, agen: Any) -> None:
        self._asyncgens.add(agen)  # type: ignore[attr-defined]

    def _asyncgen_finalizer_hook(self, agen: Any) -> None:
        self._asyncgens.discard(agen)  # type: ignore[attr-defined]
        if self.incarnation.alive:
            self.call_soon_threadsafe(self.create_task, agen.aclose())


def _close(coroutine: Any) -> None:
    for _ in range(_MAX_WAITS):
        with suppress(BaseException):  # a finally of the dead may raise, or wait
            coroutine.close()
        if coroutine.cr_frame is None:
            return


def _settle(done: asyncio.Future[Any], result: object, fault: Exception | None) -> None:
    if done.cancelled():
        return
    if fault is not None:
        done.set_exception(fault)
    else:
        done.set_result(result)


def _no_tls(ssl: object) -> None:
    if ssl is not None:
        raise NotImplementedError("the simulated network knows no TLS")
