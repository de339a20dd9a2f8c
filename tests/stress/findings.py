"""Broken promises: found, counted, told; and those that each life of a command can break."""

import logging
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from enum import Enum, unique
from typing import Final

import psutil

from executive.values.reports import Identity, Report, Stage
from tests.support.figures import Figure, Goal

MAX_REPORTED: Final = 10
MB: Final = 1e6
Log = Callable[[str], object]
Finding = tuple[Enum, str]
"""A fault, and what it is about."""


@unique
class LifecycleFault(Enum):
    """What no command's life may show."""

    STAGE_TWICE = "stages that a command reached twice"
    ENDS = "commands without exactly one end"
    GAP = "gaps in the numbering of reports"


class Findings:
    """Counts faults, and tells the first of them."""

    def __init__(self, log: Log, findings: Iterable[Finding] = ()) -> None:
        self.counts: Counter[Enum] = Counter()
        self._log = log
        for fault, about in findings:
            self.add(fault, about)

    def add(self, fault: Enum, about: object) -> None:
        self.counts[fault] += 1
        if self.counts.total() <= MAX_REPORTED:
            self._log(f"{fault.value}: {about}")

    def figures(self, name: str, faults: type[Enum], beside: str) -> list[Figure]:
        """Return how often each fault was found; none may be."""
        return [
            Figure(f"{name}: {each.value}", self.counts[each], "", beside, Goal(0))
            for each in faults
        ]


class Lines(logging.Handler):
    """Keeps what is logged under a name instead of having it printed, until `close`."""

    def __init__(self, name: str, level: int = logging.WARNING) -> None:
        super().__init__(level)
        self.lines: list[str] = []
        self._logger = logging.getLogger(name)
        self._logger.addHandler(self)
        self._logger.propagate = False

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(record.getMessage())

    def close(self) -> None:
        self._logger.removeHandler(self)
        self._logger.propagate = True
        super().close()


def lifecycles(reports: Iterable[Report]) -> defaultdict[Identity, list[tuple[int, Stage, int]]]:
    """Return the life of each command: numbers of its reports, stages, reasons."""
    found = defaultdict(list)
    for report in sorted(reports, key=lambda each: each.sequence):
        if report.identity is not None and report.stage is not None:
            reason = report.reason.value if report.reason else 0
            found[report.identity].append((report.sequence, report.stage, reason))
    return found


def broken_lifecycles(reports: Sequence[Report]) -> Iterator[Finding]:
    """Yield what is wrong with the reports of a ledger, from the first on."""
    for identity, lifecycle in lifecycles(reports).items():
        counts = Counter(stage for _, stage, _ in lifecycle)
        for stage, count in counts.items():
            if count > 1 and stage is not Stage.PROGRESS:
                yield LifecycleFault.STAGE_TWICE, f"{identity} {stage.name}"
        if sum(count for stage, count in counts.items() if stage.terminal) != 1:
            yield LifecycleFault.ENDS, f"{identity}: {' '.join(stage.name for stage in counts)}"
    for number, report in enumerate(reports, 1):
        if report.sequence != number:
            yield LifecycleFault.GAP, f"{report.sequence} in place {number}"
            return


def resident_mb(pid: int | None = None) -> float:
    """Return what a process holds in memory now: this one, unless told otherwise."""
    return float(psutil.Process(pid).memory_info().rss / MB)
