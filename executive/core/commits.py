"""`Commits` hands records to the ledger's writer, and acts on committed batches.

Nothing in a turn waits for the disk. Reports and answers are sent, and goals start, once the batch
that holds them is committed.
"""

import logging
from pathlib import Path

from executive.core.pose_keeper import PoseKeeper
from executive.core.reactions import Reactions
from executive.core.recorder import Recorder
from executive.goals import Context
from executive.record import Ledger, LedgerError, Notifications, StopLatch

_LOG = logging.getLogger(__name__)


class Commits:
    """The only user of the ledger's writer while the executive runs."""

    def __init__(
        self,
        context: Context,
        ledger: Ledger,
        latch: StopLatch,
        notifications: Notifications,
        pose: PoseKeeper,
        reactions: Reactions,
        recorder: Recorder,
    ) -> None:
        self._context = context
        self._ledger = ledger
        self._latch = latch
        self._notifications = notifications
        self._pose = pose
        self._reactions = reactions
        self._recorder = recorder
        self._released: int | None = None

    def flush(self) -> bool:
        """Hand everything written over to the writer; return whether it is committed already."""
        self._pose.store(still=self._context.goals.motion.active is None)
        ledger = self._ledger
        if self._context.latches.stopped_by is not None or self._latch.stopped_by is None:
            self._released = None
        elif self._released is None:
            self._released = ledger.last_batch
        change = self._latch.take_change()
        idle = change is None and self._released is None and not self._notifications.waiting
        if idle and ledger.settled:
            self._recorder.on_writer_state(ledger.poll(), ledger.sealed)  # recordings count polls
            return True
        ledger.seal(change)
        self.settle()
        if self._released is not None and self._released <= ledger.state.durable:
            self._latch.clear()
            ledger.seal(self._latch.take_change())
            self.settle()
        return ledger.settled

    def settle(self) -> bool:
        """Send committed reports and answers; return whether a goal is released."""
        before, state = self._ledger.state, self._ledger.poll()
        self._recorder.on_writer_state(state, self._ledger.sealed)
        if state.unstored is not None and state.latch_error is not None and not before.unstored:
            stopped = state.unstored.stopped_by is not None
            self._reactions.on_latch_failure(stopped, state.latch_error)
        if state.error is not None:
            if before.error is None:
                _LOG.error("%s", state.error)
            self._reactions.on_ledger_failure(state.error)
        self._notifications.send_committed()
        return self._context.goals.set_durable(state.durable)


def open_stop_latch(ledger: Ledger) -> StopLatch:
    """Open the stop latch beside a ledger.

    Raises:
        LedgerError: it cannot be created, read or written.
    """
    path = Path(ledger.path).with_suffix(".stop")
    try:
        latch = StopLatch(path)
    except OSError as error:
        raise LedgerError(f"stop latch {path}: {error.strerror}") from error
    if stop := ledger.last_stop():  # the file may be new, or its write may have failed
        latch.set(str(stop))
    return latch
