"""`Histogram` of durations, `ReportCounter` of commands and faults; since the start of the process.

One thread counts, any thread reads. All label values are declared here or in the
catalogues of commands, reasons and faults, so that peers cannot add time series.
"""

from bisect import bisect_left
from collections import Counter
from collections.abc import Hashable, Iterable
from typing import Final

from executive.commands import Command, all_declarations
from executive.faults import DECLARED
from executive.values.reasons import Reason, UnknownReason
from executive.values.reports import TERMINAL, Report, ReportKind, Stage

BUCKETS_S: Final = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0)
MAX_OPEN: Final = 5000
"""Maximum number of stored names of open commands; beyond it the first is dropped."""
OTHER: Final = "other"
_COMMANDS: Final = frozenset(each.name for each in all_declarations())
_FAULTS: Final = frozenset([*DECLARED, *(each.name.lower() for each in Reason)])
_NO_BEGINNING: Final = (Reason.FAULT_CLEARED, Reason.POSE_UNCERTAIN)


class Histogram:
    """Numbers of durations by upper bound.

    Attributes:
        counts: number for each of `BUCKETS_S`, and of longer ones.
        sum_s: their sum.
    """

    def __init__(self) -> None:
        self.counts = [0] * (len(BUCKETS_S) + 1)
        self.sum_s = 0.0

    def observe(self, duration_s: float) -> None:
        """Count a duration."""
        self.counts[bisect_left(BUCKETS_S, duration_s)] += 1
        self.sum_s += duration_s


class ReportCounter:
    """Counts ends of commands, each once, and beginnings of faults.

    All series of commands and reasons exist from the start, since Prometheus does not see the
    increase of a series from nothing to 1.

    Attributes:
        commands: numbers by name and terminal state.
        reasons: numbers by name and number of the reason, of commands that have one.
        faults: numbers by name.
        lost: number of commands that a relay reported as lost.
    """

    def __init__(self) -> None:
        self.commands = Counter({(name, each.name): 0 for name in _COMMANDS for each in TERMINAL})
        self.reasons = Counter({_labels(each): 0 for each in Reason})
        self.faults: Counter[str] = Counter()
        self.lost = 0
        self._names: dict[Hashable, str] = {}
        self._last = 0

    def resume(self, last: int, unfinished: Iterable[Command] = ()) -> None:
        """Count only reports after a number, and know commands of earlier processes."""
        self._last = last
        for command in unfinished:
            self.begin(command.identity, command.name)

    def begin(self, key: Hashable, name: str) -> None:
        """Store the name of a command until its end; other texts are ignored."""
        if name in _COMMANDS:
            self._names[key] = name
        if len(self._names) > MAX_OPEN:
            del self._names[next(iter(self._names))]

    def note(self, report: Report, number: int, *, is_lost: bool = False) -> None:
        """Count a report; a number that is not higher than the last is a repetition.

        With `is_lost` it is a relay's, that a command is lost. A late report may still end it.
        """
        if number <= self._last:
            return
        self._last = number
        self.lost += is_lost
        if report.kind is ReportKind.COMMAND and report.stage is not None:
            if report.stage is Stage.RECEIVED:
                self.begin(report.identity, report.text)
            elif report.stage.terminal:
                self.commands[self._names.pop(report.identity, OTHER), report.stage.name] += 1
                if report.reason is not None:
                    self.reasons[_labels(report.reason)] += 1
        elif report.fault is not None and report.reason not in _NO_BEGINNING:
            self.faults[report.fault if report.fault in _FAULTS else OTHER] += 1


def _labels(reason: Reason | UnknownReason) -> tuple[str, str]:
    """Return name and number of a reason; a number that is not declared is not a label."""
    return (reason.name, str(reason.value)) if isinstance(reason, Reason) else (OTHER, "")
