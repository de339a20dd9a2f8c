"""Watches that a rover that was stopped stands until it is resumed, over restarts too."""

from collections.abc import Sequence

from executive.values.geometry import STANDING
from executive.values.parameters import ParameterValue
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, Stage
from tests.support.kinematic import KinematicRover


class StopWatch(KinematicRover):
    """A rover that knows from the reports whether it is stopped; a `Downlink` of its executives.

    Attributes:
        stopped_by: the stop that holds it; None if it may move.
        moved: stops during which it moved, each once.
    """

    def __init__(self) -> None:
        super().__init__()
        self.stopped_by: Identity | None = None
        self.moved: dict[Identity, None] = {}
        self._resumes: set[Identity] = set()
        self._last = 0

    def begin(self, last_sequence: int) -> None:
        """Take the reports of a new executive: numbers that were not written are given again."""
        self._last = last_sequence

    def advance(self, step_s: float) -> None:
        """Move for some time; what was commanded within a turn counts when the turn is reported."""
        if step_s > 0.0 and self.velocity != STANDING and self.stopped_by is not None:
            self.moved[self.stopped_by] = None
        super().advance(step_s)

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Take new reports; what answers a repeat is older."""
        for report in reports:
            if report.sequence <= self._last or report.identity is None:
                continue
            self._last = report.sequence
            match report.stage, report.text:
                case Stage.RECEIVED, "stop":
                    self.stopped_by = report.identity
                case Stage.RECEIVED, "resume":
                    self._resumes.add(report.identity)
                case Stage.EXECUTED, _ if report.identity in self._resumes:
                    self.stopped_by = None

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Do nothing."""

    def send_file_event(self, event: FileEvent) -> None:
        """Do nothing."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Do nothing."""
