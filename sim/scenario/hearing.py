"""What the ground hears of a rover in lock step: everything, but in an eclipse."""

from math import inf

from sim.lockstep import Recorder
from sim.scenario.record import ALMOST_S, Record


class Hearing:
    """Carries what a rover says into the record of a run.

    Args:
        said: what the rover says.
        record: what the ground hears.
    """

    def __init__(self, said: Recorder, record: Record) -> None:
        """Hear from now on."""
        self._said = said
        self._record = record
        self._batches = 0
        self._until_s = -inf
        self.dark = False

    def eclipse(self, until_s: float) -> None:
        """Hear nothing until then; reports are heard afterwards, telemetry is not."""
        self._until_s = max(self._until_s, until_s)
        self.dark = True

    def listen(self, now_s: float) -> None:
        """Take in what was said since the last call."""
        self.dark = now_s < self._until_s - ALMOST_S
        said, record = self._said, self._record
        batches = said.telemetry_batches[self._batches :]
        self._batches += len(batches)
        if self.dark:
            return
        for batch in batches:
            record.values += record.heard(batch)
        record.reports += said.reports[len(record.reports) :]
        record.file_events += said.file_events[len(record.file_events) :]
        record.plans += said.plans[len(record.plans) :]
