"""What `rover-nxt` does with texts, events of the brick and new listeners. No ROS, no USB."""

from collections.abc import Callable, Iterable, Mapping

from adapters.mocup.brick.record import Link
from adapters.mocup.brick.router import RESTARTED, Inbox, Router
from adapters.mocup.brick.usb import Found, Heard, Lost, SessionEvent
from adapters.mops import fingerprint


class BrickService:
    """Serves a router. What the brick still owed before is reported as failed.

    Args:
        router: whose message goes where.
        confirm: publishes the fingerprint of a string of the relay's commands that was taken.

    Attributes:
        inbox: where texts wait that have arrived.
        why: why the brick is not there; empty if it is.
    """

    def __init__(self, router: Router, confirm: Callable[[int], None]) -> None:
        self._router, self._confirm = router, confirm
        self._listeners: Mapping[Link, frozenset[object]] = dict.fromkeys(Link, frozenset())
        self.inbox = Inbox(router.is_stop)
        self.why = "no brick yet"
        router.lost(RESTARTED)

    def serve(self) -> Link | None:
        """Take one text, a stop first; return its link, None where none waits."""
        if (arrived := self.inbox.take()) is None:
            return None
        taken = self._router.command(arrived.link, arrived.text, arrived.overtaken)
        if taken and arrived.link is Link.RELAY:
            self._confirm(fingerprint(arrived.text))
        return arrived.link

    def drain(self, events: Iterable[SessionEvent]) -> None:
        """Take events of the brick."""
        for event in events:
            match event:
                case Heard(octets):
                    self._router.heard(octets)
                case Found(visit):
                    self.why = ""
                    self._router.found(visit)
                case Lost(why):
                    self.why = why
                    self._router.lost()

    def look(self, listeners: Mapping[Link, frozenset[object]]) -> None:
        """Do what is due, and resend last replies to new listeners; call once a second."""
        self._router.look()
        for link, found in listeners.items():
            if found - self._listeners[link]:
                self._router.resend_last(link)
        self._listeners = listeners
