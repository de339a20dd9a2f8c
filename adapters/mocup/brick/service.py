"""`BrickService` passes received texts and events of the brick to the router. No ROS, no USB."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

from adapters.mocup.brick.record import BrickLink, BrickRecord
from adapters.mocup.brick.router import RESTARTED, Router
from adapters.mocup.brick.usb import BrickConnected, BrickDisconnected, OctetsReceived, SessionEvent
from adapters.mops import Message, fingerprint


@dataclass(frozen=True, slots=True)
class ReceivedText:
    """A text received on a link.

    Attributes:
        overtaken: whether a later stop was processed first.
    """

    link: BrickLink
    text: str
    overtaken: bool


MAX_INBOX: Final = 1000


@dataclass(slots=True)
class DurableOutput:
    """Output to the links, in order, that waits until the commits before survive loss of power.

    Stops on the direct link do not wait. Output beyond `MAX_INBOX` is requested again.

    Attributes:
        publish: publishes a notification, or the fingerprint of an accepted string, on a link.
        start_sync: calls `record.sync` on another thread, and then `on_synced` on this one.
        log: called with the fault of a sync, in one line.
    """

    record: BrickRecord
    stop_code: int
    publish: Callable[[BrickLink, Message | int], None]
    start_sync: Callable[[], None]
    log: Callable[[str], None]
    _held: dict[tuple[BrickLink, Message | int], int] = field(default_factory=dict)
    _syncing: bool = False

    def put(self, link: BrickLink, output: Message | int) -> None:
        """Publish output, or hold it once."""
        urgent = link is BrickLink.DIRECT and getattr(output, "code", None) == self.stop_code
        if urgent or not (self._held or self.record.durable < self.record.sealed):
            self.publish(link, output)
        elif len(self._held) < MAX_INBOX:
            self._held.setdefault((link, output), self.record.sealed)
            self.sync()

    def sync(self) -> None:
        """Start to sync the record if necessary; call it once a second, too."""
        if not self._syncing and self.record.durable < self.record.sealed:
            self._syncing = True
            self.start_sync()

    def on_synced(self, fault: BaseException | None) -> None:
        """Publish the output that the sync covers, and sync the commits since its start."""
        self._syncing = False
        for (link, output), commit in list(self._held.items()):
            if commit <= self.record.durable:
                del self._held[link, output]
                self.publish(link, output)
        if fault is None:
            self.sync()
        else:
            self.log(f"{self.record.path}: {fault}")


class StopFirstQueue:
    """Texts in order of arrival, except that stops are first.

    Args:
        is_stop: returns whether a text includes a stop.
    """

    def __init__(self, is_stop: Callable[[str], bool]) -> None:
        self._is_stop = is_stop
        self._stops: deque[ReceivedText] = deque()
        self._others: deque[ReceivedText] = deque()

    def put(self, link: BrickLink, text: str) -> bool:
        """Add a text; return False if the queue is full."""
        is_stop = self._is_stop(text)
        lane = self._stops if is_stop else self._others
        if is_stop:
            self._others = deque(replace(each, overtaken=True) for each in self._others)
        if len(lane) < MAX_INBOX:
            lane.append(ReceivedText(link, text, overtaken=False))
            return True
        return False

    def take(self) -> ReceivedText | None:
        """Remove and return the next text; None if the queue is empty."""
        waiting = self._stops or self._others
        return waiting.popleft() if waiting else None


class BrickService:
    """Serves a router. Commands left unanswered by an earlier run are reported as failed.

    Args:
        router: routes the messages.
        confirm: publishes the fingerprint of an accepted string on a link.
        confirmed: whether `rover-relay` acknowledges replies; if not, they are sent once.

    Attributes:
        inbox: received texts that are not processed yet.
        listeners: subscribers to the notifications of each link, at the last poll.
        why: reason why the brick is not connected; empty if it is.
    """

    def __init__(
        self, router: Router, confirm: Callable[[BrickLink, int], None], *, confirmed: bool
    ) -> None:
        self._router, self._confirm, self._confirmed = router, confirm, confirmed
        self._before: Sequence[int] = ()
        self.listeners: Mapping[BrickLink, frozenset[object]] = dict.fromkeys(
            BrickLink, frozenset()
        )
        self.inbox = StopFirstQueue(router.is_stop)
        self.why = "no brick yet"
        router.on_disconnected(RESTARTED)

    def serve(self) -> BrickLink | None:
        """Process one text, a stop first; return its link, None if the queue is empty."""
        if (arrived := self.inbox.take()) is None:
            return None
        if self._router.process(arrived.link, arrived.text, arrived.overtaken):
            self._confirm(arrived.link, fingerprint(arrived.text))
        return arrived.link

    def drain(self, events: Iterable[SessionEvent]) -> None:
        """Process events of the brick."""
        for event in events:
            match event:
                case OctetsReceived(octets):
                    self._router.on_octets(octets)
                case BrickConnected(visit):
                    self.why = ""
                    self._router.on_connected(visit)
                case BrickDisconnected(why):
                    self.why = why
                    self._router.on_disconnected()

    def on_confirmed(self, mark: int) -> None:
        """Process the acknowledgement of a reply: `rover-relay` has it on its disk."""
        self._router.unconfirmed.pop(mark, None)

    def poll(self, listeners: Mapping[BrickLink, frozenset[object]]) -> None:
        """Poll the router, and resend last replies to new subscribers; call once a second."""
        self._router.poll()
        unconfirmed = self._router.unconfirmed
        if self._confirmed and listeners[BrickLink.RELAY]:
            for mark in [each for each in self._before if each in unconfirmed]:
                self._router.ports.notify(BrickLink.RELAY, unconfirmed[mark])
        self._before = tuple(unconfirmed)
        for link, found in listeners.items():
            if found - self.listeners[link]:
                self._router.resend_last(link)
        self.listeners = listeners
