"""The core's clock on ROS: time of the node, which may be simulated, and UTC of this machine."""

import time

from rclpy.clock import Clock as NodeClock


class RosClock:
    """Simulated time for deadlines and ages; UTC of this machine for stamps and lifetimes.

    A command's lifetime is counted in the UTC of the ground, whatever a simulation does with time,
    so that `utc_s` is never simulated.

    Args:
        clock: the node's clock, with `use_sim_time` set. When it jumps back, because the simulation
            started anew, time stands still here for that moment and then goes on.
    """

    def __init__(self, clock: NodeClock) -> None:
        """Start at the clock's time."""
        self._clock = clock
        self._last_ns = clock.now().nanoseconds
        self._offset_ns = 0

    def now_s(self) -> float:
        """Return seconds that never step back."""
        now_ns = self._clock.now().nanoseconds
        if now_ns < self._last_ns:
            self._offset_ns += self._last_ns - now_ns
        self._last_ns = now_ns
        return (now_ns + self._offset_ns) * 1e-9

    def utc_s(self) -> float:
        """Return seconds since 1970-01-01 UTC."""
        return time.time()
