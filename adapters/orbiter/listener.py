"""The port to whoever is told of what comes from a rover."""

from collections.abc import Sequence
from typing import Protocol

from executive.parameters import ParameterValue
from executive.reports import Report


class Listener(Protocol):
    """Who is told of what comes from a rover."""

    def report(self, report: Report) -> None:
        """Tell a report."""
        ...

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Tell parameter values."""
        ...
