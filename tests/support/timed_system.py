"""The real computer with another time of day."""

from collections.abc import Callable

from adapters.system import OperatingSystem


class TimedSystem(OperatingSystem):
    """Takes the time of day from a test."""

    def __init__(self, utc_s: Callable[[], float]) -> None:
        self.utc_s = utc_s
