"""`PoseKeeper` saves the pose uncertainty in the ledger for a restart, and reports its changes."""

import json
from collections.abc import Sequence
from typing import Final, TypeVar

from cattrs.preconf.json import make_converter

from executive.faults import DECLARED
from executive.record import Ledger, Notifications
from executive.safety import Fault, FaultMonitor, PoseMonitor, StoredPose
from executive.settings import Settings
from executive.state import Status, Uncertainty
from executive.values.clock import Clock
from executive.values.reasons import Reason
from executive.values.reports import Severity

EVENT_S: Final = 1.0
EVENT_M: Final = 0.05
EVENT_RAD: Final = 0.02
"""Minimum interval between reports of the uncertainty, and the changes that are reported."""


class PoseKeeper:
    """Monitors the pose, stores its state with every report, and reports changes."""

    def __init__(
        self,
        clock: Clock,
        settings: Settings,
        safety: FaultMonitor,
        status: Status,
        ledger: Ledger,
        notifications: Notifications,
    ) -> None:
        self._clock, self._status, self._notifications = clock, status, notifications
        self._record = PoseRecord(ledger)
        stored = self._record.read(StoredPose)
        self._monitor = PoseMonitor(clock, settings, safety.history, status, stored)
        self._reported, self._reported_s = Uncertainty(), clock.now_s()

    def update(self, active: Sequence[Fault]) -> None:
        """Run the monitor with the active faults, and report changes of the uncertainty."""
        self._monitor.update(active)
        now, last, now_s = self._status.uncertainty, self._reported, self._clock.now_s()
        changed = (
            bool(now) is not bool(last)
            or abs(now.position_m - last.position_m) > EVENT_M
            or abs(now.heading_rad - last.heading_rad) > EVENT_RAD
        )
        if not changed or (last and now_s - self._reported_s < EVENT_S):
            return
        self._reported, self._reported_s = now, now_s
        event = self._notifications.report_event
        if now:
            text = f"the pose is uncertain by {now}, since {now.cause}"
            fault = now.cause if now.cause in DECLARED else None
            event(Severity.WARNING, text, Reason.POSE_UNCERTAIN, now.figures, fault=fault)
        else:
            text = f"the pose is certain again, by {now.cause}"
            event(Severity.INFORMATIONAL, text, Reason.FAULT_CLEARED, now.figures)

    def confirm(self, uncertainty: Uncertainty) -> None:
        """Set the uncertainty of the present pose to a bound that an operator confirmed."""
        self._monitor.confirm(uncertainty)

    def store(self, still: bool) -> None:
        """Write the pose with the next commit, if reports or states of plans are to be committed.

        Another commit would make the tick wait for the disk again. Only the first pose and the
        first frame of a second odometry have their own, for a stationary rover without a report.

        Args:
            still: whether the rover is commanded to be stationary.
        """
        if self._notifications.pending or self._record.has_commit or self._monitor.unstored:
            self._record.write(self._monitor.state_to_store(still))


T = TypeVar("T")

_SCHEMA: Final = """
CREATE TABLE IF NOT EXISTS pose (only_row INTEGER PRIMARY KEY, state TEXT NOT NULL);
"""
_CONVERTER: Final = make_converter()


class PoseRecord:
    """The last committed state, so that a restart does not turn a wrong pose into a certain one.

    Raises:
        LedgerError: from every method, if the file cannot be read or written.
    """

    def __init__(self, ledger: Ledger) -> None:
        self._ledger = ledger
        ledger.add_tables(_SCHEMA)

    @property
    def has_commit(self) -> bool:
        """Whether writes wait for the next commit."""
        return self._ledger.last_batch > self._ledger.sealed

    def read(self, kind: type[T]) -> T | None:
        """Return the last committed state as its class; None before the first."""
        rows = self._ledger.rows("SELECT state FROM pose")
        return _CONVERTER.structure(json.loads(rows[0][0]), kind) if rows else None

    def write(self, state: object) -> None:
        """Write the state with the next commit; without effect for None."""
        if state is None:
            return
        text = json.dumps(_CONVERTER.unstructure(state))
        self._ledger.write("INSERT OR REPLACE INTO pose VALUES (0, ?)", (text,))
