"""`guarded`: a separate process that stops the rover when the executive has ended.

A base stops by itself without velocities, the Jackal's after 0.25 s. A process cannot act after
kill -9 on itself; but the kernel closes its end of a pipe at once, and the process at the other
end publishes zero.
"""

import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node

from adapters.ros import GUARD_NAME, RosMotionRover, RosVelocityRover, declare_topics, ros_node
from adapters.ros.node import clock_of
from executive.settings import LocomotionKind, Settings

PERIOD_S: Final = 0.05
"""Publication period of zero."""
ZERO_S: Final = 0.3
"""Duration of that publication, until the base's own timeout has passed."""
RESTART_S: Final = 0.5
"""Delay of a restart, so that a guard that always crashes does not occupy the processor."""
DISCOVERY_S: Final = 20.0
"""Discovery timeout of the mux; after it the mux counts as absent. Chosen, not measured."""
RUNS: Final = "the guard runs"
_ARM, _WELL = b"+", b"."
_LOG: Final = logging.getLogger(__name__)


class Guard:
    """A process that stops a rover if the process that created it ends before `close`.

    Create it before any thread, ROS context or lock: the supervisor is forked, must not inherit
    them, and forks the guard again after it was killed.

    Args:
        arguments: settings of the asset, ROS parameter file, ROS arguments, class of the rover.

    Attributes:
        state: state of the guard, for `/diagnostics`.
    """

    def __init__(self, *arguments: Any) -> None:
        self.state = RUNS
        reading, self._writing = os.pipe()
        self._deaths, signalling = os.pipe()
        self._supervisor = os.fork()
        if self._supervisor == 0:
            try:
                os.close(self._writing)
                os.close(self._deaths)
                _supervise(reading, signalling, *arguments)
            finally:
                os._exit(1)  # the executive's code must not continue in the child
        os.close(reading)
        os.close(signalling)
        os.set_blocking(self._deaths, False)

    def arm(self) -> None:
        """Activate the guard."""
        _write(self._writing, _ARM)

    def take_event(self) -> str | None:
        """Return the event of the guard since the last call, or None."""
        with suppress(BlockingIOError):
            octet = os.read(self._deaths, 1)
            if octet:
                self.state = f"the guard was killed by signal {octet[0]} and restarted"
                return self.state
            if self._supervisor:
                os.waitpid(self._supervisor, 0)
                self._supervisor = 0
                self.state = "the supervisor of the guard ended: the guard is no longer restarted"
                return self.state
        return None

    def close(self) -> None:
        """End the guard without a stop of the rover."""
        _write(self._writing, _WELL)
        os.close(self._writing)
        os.close(self._deaths)
        if self._supervisor:
            os.waitpid(self._supervisor, 0)


@contextmanager
def guarded(settings: Settings, *arguments: Any) -> Iterator[Guard | None]:
    """Yield a guard of a rover; None for one that executes whole motions: it stops by itself.

    Args:
        settings: settings of the asset.
        arguments: arguments of `Guard` after the settings.
    """
    by_velocity = settings.locomotion is LocomotionKind.VELOCITY
    with closing(Guard(settings, *arguments)) if by_velocity else nullcontext() as guard:
        yield guard


def _supervise(reading: int, write_fd: int, *arguments: Any) -> None:
    """Fork guards until one exits by itself; write the signal that killed each one."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    first = True
    while True:
        child = os.fork()
        if child == 0:
            os.close(write_fd)
            try:
                if not first or os.read(reading, 1) == _ARM:
                    _guard(reading, *arguments)
            except Exception as error:
                _LOG.error("the guard of the executive raised %r", error, exc_info=error)
            finally:
                os._exit(0)
        _, status = os.waitpid(child, 0)
        if not os.WIFSIGNALED(status):
            return
        _write(write_fd, bytes([os.WTERMSIG(status)]))
        first = False
        time.sleep(RESTART_S)


def _write(writing: int, octets: bytes) -> None:
    with suppress(BrokenPipeError):  # the reader was killed
        os.write(writing, octets)


def _guard(
    reading: int,
    settings: Settings,
    parameters: Path,
    ros_arguments: tuple[str, ...],
    rover_kind: Callable[..., RosVelocityRover | RosMotionRover],
) -> None:
    """Wait for the end of the process at the other end of the pipe, then stop the rover."""
    asset = settings.asset
    with ros_node(GUARD_NAME, asset, parameters=parameters, ros_arguments=ros_arguments) as node:
        rover = rover_kind(node, declare_topics(node), clock_of(node), settings)
        while (octet := os.read(reading, 1)) == _ARM:
            pass  # sent before a restart
        if octet == _WELL:
            return
        until_s, subscribed = time.monotonic() + DISCOVERY_S, False
        while time.monotonic() < until_s:
            if not subscribed and _lock_has_subscriber(node, settings):
                until_s, subscribed = time.monotonic() + ZERO_S, True
            rover.emergency_stop()
            time.sleep(PERIOD_S)
        by = "" if subscribed else "; no mux was subscribed to its lock"
        _LOG.error("the executive has ended: zero was published instead%s", by)


def _lock_has_subscriber(node: Node, settings: Settings) -> bool:
    """Return whether the mux is subscribed to its lock; True without a mux."""
    mux = settings.mux
    if mux is None:
        return True
    return node.count_subscribers(node.resolve_topic_name(mux.locks[mux.lock].topic)) > 0
