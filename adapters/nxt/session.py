"""Keeps a brick: looks for it, listens and speaks to it, and looks again when it is gone.

Two threads, so that a brick that is slow or dead holds up nobody: one looks and listens, and for
as long as a brick is there another writes.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Empty, Full, Queue
from threading import Event, Lock, Thread
from typing import Final

from adapters.nxt.brick import Brick, BrickError

FIRST_WAIT_S: Final = 0.2
LONGEST_WAIT_S: Final = 2.0
"""A brick that is plugged in is noticed at the latest after this."""
OUTGOING: Final = 32
INCOMING: Final = 256
MOST_TIMEOUTS: Final = 10
"""A brick that takes nothing for so many writes in a row is taken for dead."""
_LOOK_S: Final = 0.1
_RESYNCHRONISE: Final = b"#"
_LOG: Final = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Heard:
    """Octets that the brick said."""

    octets: bytes


@dataclass(frozen=True, slots=True)
class Found:
    """A brick is there, for the so many-th time, from 1."""

    visit: int


@dataclass(frozen=True, slots=True)
class Lost:
    """The brick is gone, and with it what was on its way there."""

    why: str


SessionEvent = Heard | Found | Lost


@dataclass(slots=True)
class _Visit:
    """One time that a brick is there.

    Attributes:
        over: set when the brick is to be left, by either thread.
        why: what ended it, first things first; empty when the session ended.
        spoke: whether the brick said anything.
    """

    brick: Brick
    over: Event = field(default_factory=Event)
    why: list[str] = field(default_factory=list)
    spoke: bool = False


class BrickSession:
    """A brick that may come and go.

    What it says waits for `events` in a bounded queue: when nobody takes it, the brick is no longer
    read, and USB holds it back.

    Args:
        claim: finds and claims the brick.
        wake: called on a thread of the session when an event waits.
    """

    def __init__(self, claim: Callable[[], Brick], wake: Callable[[], None]) -> None:
        """Do nothing before `start`."""
        self._claim = claim
        self._wake = wake
        self._events: Queue[SessionEvent] = Queue(INCOMING)
        self._outgoing: Queue[bytes] = Queue(OUTGOING)
        self._connected = False
        self._visits = 0
        self._cut_short = False
        self._lock = Lock()
        self._closing = Event()
        self._thread = Thread(target=self._run, name="nxt-read")

    def start(self) -> None:
        """Begin to look for the brick."""
        self._thread.start()

    def close(self) -> None:
        """Release the brick and end the threads."""
        self._closing.set()
        self._thread.join()

    @property
    def connected(self) -> bool:
        """Whether a brick is there."""
        return self._connected

    def send(self, octets: bytes, visit: int | None = None) -> bool:
        """Have octets written. Never blocks.

        Args:
            octets: what is for the brick.
            visit: the time that it is there for which they are meant; None for whichever it is.

        Returns:
            False where no brick is, or not as meant, or too much waits.
        """
        with self._lock:
            if not self._connected or visit not in (None, self._visits):
                return False
            try:
                self._outgoing.put_nowait(octets)
            except Full:
                return False
            return True

    def events(self) -> list[SessionEvent]:
        """Take what happened since. Never blocks."""
        taken: list[SessionEvent] = []
        while len(taken) < INCOMING:
            try:
                taken.append(self._events.get_nowait())
            except Empty:
                break
        return taken

    def _run(self) -> None:
        wait_s, said = FIRST_WAIT_S, ""
        while not self._closing.is_set():
            try:
                with self._claim() as brick:
                    said = ""
                    visit = _Visit(brick)
                    self._serve(visit)
                    if visit.spoke:
                        wait_s = FIRST_WAIT_S
            except BrickError as error:
                if str(error) != said:
                    said = str(error)
                    _LOG.warning("%s; it is looked for again", said)
            except Exception as error:
                _LOG.error("looking for the brick raised %r", error, exc_info=error)
            self._closing.wait(wait_s)
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)

    def _serve(self, visit: _Visit) -> None:
        writer = Thread(target=self._until_over, args=(visit, self._write), name="nxt-write")
        _LOG.info("the brick is there")
        with self._lock:
            self._visits += 1
        self._put(Found(self._visits))
        with self._lock:
            self._connected = True
        writer.start()
        self._until_over(visit, self._read)
        with self._lock:
            self._connected = False
        writer.join()
        self._forget_what_waits()
        if visit.why:
            _LOG.warning("the brick is gone: %s; it is looked for again", visit.why[0])
            self._put(Lost(visit.why[0]))

    def _until_over(self, visit: _Visit, work: Callable[[_Visit], None]) -> None:
        try:
            work(visit)
        except BrickError as error:
            visit.why.append(str(error))
        except Exception as error:
            visit.why.append(repr(error))
            _LOG.error("a thread of the brick raised %r", error, exc_info=error)
        visit.over.set()

    def _read(self, visit: _Visit) -> None:
        while not (visit.over.is_set() or self._closing.is_set()):
            if octets := visit.brick.read():
                visit.spoke = True
                self._put(Heard(octets))

    def _write(self, visit: _Visit) -> None:
        if self._cut_short:
            self._write_whole(visit, _RESYNCHRONISE)
        while not visit.over.is_set():
            try:
                octets = self._outgoing.get(timeout=_LOOK_S)
            except Empty:
                continue
            self._write_whole(visit, octets)

    def _write_whole(self, visit: _Visit, octets: bytes) -> None:
        self._cut_short = True
        timeouts = 0
        while octets and not visit.over.is_set():
            taken = visit.brick.write(octets)
            octets = octets[taken:]
            timeouts = 0 if taken else timeouts + 1
            if timeouts >= MOST_TIMEOUTS:
                raise BrickError("it takes nothing any more")
        self._cut_short = bool(octets)

    def _forget_what_waits(self) -> None:
        """Drop commands that a brick did not get: come back, it is not to obey old ones."""
        while not self._outgoing.empty():
            self._outgoing.get_nowait()

    def _put(self, event: SessionEvent) -> None:
        while not self._closing.is_set():
            try:
                self._events.put(event, timeout=_LOOK_S)
            except Full:
                self._wake()
                continue
            self._wake()
            return
