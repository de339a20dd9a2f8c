"""What `rover-nxt` does with texts, events of the brick and new listeners. No ROS, no USB."""

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from adapters.mocup.brick.record import BrickLink
from adapters.mocup.brick.router import RESTARTED, Router
from adapters.mocup.brick.usb import BrickConnected, BrickDisconnected, OctetsReceived, SessionEvent
from adapters.mops import fingerprint


@dataclass(frozen=True, slots=True)
class ReceivedText:
    """A text that came by a link.

    Attributes:
        overtaken: whether a stop that came after it was taken before it.
    """

    link: BrickLink
    text: str
    overtaken: bool


MOST_ARRIVED: Final = 1000


class StopFirstQueue:
    """Texts in the order in which they arrived, but stops first.

    Args:
        is_stop: returns whether there is a stop in a text.
    """

    def __init__(self, is_stop: Callable[[str], bool]) -> None:
        self._is_stop = is_stop
        self._stops: deque[ReceivedText] = deque()
        self._others: deque[ReceivedText] = deque()

    def put(self, link: BrickLink, text: str) -> bool:
        """Let a text arrive; return False where too many wait."""
        is_stop = self._is_stop(text)
        lane = self._stops if is_stop else self._others
        if is_stop:
            self._others = deque(replace(each, overtaken=True) for each in self._others)
        if len(lane) < MOST_ARRIVED:
            lane.append(ReceivedText(link, text, overtaken=False))
            return True
        return False

    def take(self) -> ReceivedText | None:
        """Return the next text; None where none waits."""
        waiting = self._stops or self._others
        return waiting.popleft() if waiting else None


class BrickService:
    """Serves a router. What the brick still owed before is reported as failed.

    Args:
        router: whose message goes where.
        confirm: publishes, for a link, the fingerprint of a string that was taken.
        confirmed: whether `rover-relay` confirms replies; else they are sent once.

    Attributes:
        inbox: where texts wait that have arrived.
        listeners: who subscribes to the notifications of each link, as of the last look.
        why: why the brick is not there; empty if it is.
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
        router.lost(RESTARTED)

    def serve(self) -> BrickLink | None:
        """Take one text, a stop first; return its link, None where none waits."""
        if (arrived := self.inbox.take()) is None:
            return None
        if self._router.command(arrived.link, arrived.text, arrived.overtaken):
            self._confirm(arrived.link, fingerprint(arrived.text))
        return arrived.link

    def drain(self, events: Iterable[SessionEvent]) -> None:
        """Take events of the brick."""
        for event in events:
            match event:
                case OctetsReceived(octets):
                    self._router.heard(octets)
                case BrickConnected(visit):
                    self.why = ""
                    self._router.found(visit)
                case BrickDisconnected(why):
                    self.why = why
                    self._router.lost()

    def kept(self, mark: int) -> None:
        """Take a reply for confirmed: `rover-relay` has it on its disk."""
        self._router.unconfirmed.pop(mark, None)

    def look(self, listeners: Mapping[BrickLink, frozenset[object]]) -> None:
        """Do what is due, and resend last replies to new listeners; call once a second."""
        self._router.look()
        unconfirmed = self._router.unconfirmed
        if self._confirmed and listeners[BrickLink.RELAY]:
            for mark in [each for each in self._before if each in unconfirmed]:
                self._router.ports.notify(BrickLink.RELAY, unconfirmed[mark])
        self._before = tuple(unconfirmed)
        for link, found in listeners.items():
            if found - self.listeners[link]:
                self._router.resend_last(link)
        self.listeners = listeners
