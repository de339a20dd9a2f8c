"""Parameters, sent at the status interval or on change."""

from collections.abc import Callable, Sequence

from executive.values.clock import Clock
from executive.values.parameters import Parameter, ParameterValue


class Telemetry:
    """Sends the status (thesis 5.1.3, status interval), first immediately.

    Attributes:
        interval_s: seconds between two transmissions of all values; 0 sends changed values only.
    """

    def __init__(
        self,
        clock: Clock,
        sample: Callable[[], Sequence[ParameterValue]],
        send: Callable[[Sequence[ParameterValue]], None],
        interval_s: float,
    ) -> None:
        self._clock = clock
        self._sample = sample
        self._send = send
        self.interval_s = interval_s
        self._next_s = clock.now_s()
        self._sent: dict[Parameter, float | None] = {}

    def set_interval(self, interval_s: float) -> None:
        """Change the interval, and send immediately."""
        self.interval_s = interval_s
        self._next_s = self._clock.now_s()
        self._sent.clear()

    def update(self) -> None:
        """Send the values that are due. Called once a tick."""
        now_s = self._clock.now_s()
        if self.interval_s > 0.0:
            if now_s < self._next_s:
                return
            self._next_s = max(self._next_s + self.interval_s, now_s)
            due = self._sample()
        else:
            due = tuple(
                value
                for value in self._sample()
                if value.parameter not in self._sent or self._sent[value.parameter] != value.value
            )
            self._sent.update({value.parameter: value.value for value in due})
        if due:
            self._send(due)
