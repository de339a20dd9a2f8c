"""`Watchdog` stops the rover from a separate thread when a tick of the core's thread hangs."""

import logging
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Self

from executive.core.runner import Executive
from executive.values.geometry import STANDING
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Severity

MISSED_POLLS: Final = 10
"""Consecutive polls without a heartbeat that raise an alarm."""
_LOG = logging.getLogger(__name__)


class Watchdog:
    """Stops the rover, from a thread of its own, while the core's thread sends no heartbeat.

    It counts its own polls without a heartbeat, not seconds on a clock. A process that is starved
    or suspended as a whole suspends this thread too, and raises no alarm here; its late tick does.
    A process that has ended as a whole cannot act; then the rover's own timeout must.

    Args:
        executive: supervised executive; receives the alarm, and is made SAFE if the rover moved,
            once its thread continues.
        bound_s: seconds without a heartbeat after which it acts.
        notify: called with one line at each alarm, on the watchdog's thread.
    """

    def __init__(self, executive: Executive, bound_s: float, notify: Callable[[str], None]) -> None:
        self._executive = executive
        self._poll_s = bound_s / MISSED_POLLS
        self._publish = notify
        self._beats = 0
        self._silent_s = 0.0
        self._stopped = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watchdog", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join()

    def beat(self) -> None:
        """Record a heartbeat of the core's thread; called there several times within the bound."""
        self._beats += 1

    def _watch(self) -> None:
        seen = polls = 0
        while not self._closing.wait(self._poll_s):
            polls = polls + 1 if self._beats == seen > 0 else 0
            seen = self._beats
            if polls >= MISSED_POLLS:
                self._silent_s = polls * self._poll_s
                with suppress(Exception):  # no error may end the watchdog
                    self._on_hang(first=polls == MISSED_POLLS)

    def _on_hang(self, first: bool) -> None:
        moving = self._executive.moving or self._executive.velocity != STANDING
        if moving:
            self._stopped = True
            self._executive.emergency_stop()
        if first:
            text = f"the core has not ticked for {self._silent_s:.1f} s"
            _LOG.error("%s%s", text, "; the rover is stopped" if moving else "")
            self._executive.query(self._report)
            self._publish(text)

    def _report(self) -> None:
        """Report to the core, once its thread continues."""
        text = f"the core did not tick for {self._silent_s:.1f} s"
        figures = (Figure("silent", self._silent_s, "s"),)
        if self._stopped:
            text = f"{text}; the watchdog stopped the rover"
            self._executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, text, figures))
        else:
            self._executive.report_event(Severity.WARNING, text, figures)
        self._stopped = False
