"""A process beside the executive that has the rover stand when the executive is gone.

A base stops by itself when no velocity comes, the Jackal's after 0.25 s. Nothing in a process can
act after kill -9 on it; but the kernel closes the end of a pipe at once, and who reads the other
end publishes zero.
"""

import logging
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from rclpy.node import Node

from adapters.ros import GUARD_NAME, RosMotionRover, RosVelocityRover, declare_topics, ros_node
from adapters.ros.node import clock_of
from executive.settings import LocomotionKind, Settings

PAUSE_S: Final = 0.05
"""Zero is published so often."""
ZERO_S: Final = 0.3
"""And so long, until the base's own time-out has passed."""
DISCOVERY_S: Final = 20.0
"""A mux that this node has not discovered by then is taken for gone."""
_ARM, _WELL = b"+", b"."
_LOG: Final = logging.getLogger(__name__)


@contextmanager
def guarded(
    settings: Settings,
    parameters: Path,
    ros_arguments: tuple[str, ...],
    rover_kind: Callable[..., RosVelocityRover | RosMotionRover],
) -> Iterator[Callable[[], None]]:
    """Have a process beside this one make a rover stand if this one ends before the context does.

    A rover that carries out whole motions needs none: it has a dead-man's switch of its own. Enter
    it before there is a thread, a ROS context or a lock; call what it yields once all is up.

    Args:
        settings: of the asset.
        parameters: the ROS parameter file.
        ros_arguments: what goes to ROS as it is.
        rover_kind: the class that speaks with the rover.
    """
    if settings.locomotion is not LocomotionKind.VELOCITY:
        yield lambda: None
        return
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(writing)
        try:
            for number in (signal.SIGINT, signal.SIGTERM):
                signal.signal(number, signal.SIG_IGN)
            if os.read(reading, 1) == _ARM:
                _guard(reading, settings, parameters, ros_arguments, rover_kind)
        except Exception as error:
            _LOG.error("the guard of the executive raised %r", error, exc_info=error)
        finally:
            os._exit(0)
    os.close(reading)
    try:
        yield lambda: _write(writing, _ARM)
    finally:
        _write(writing, _WELL)
        os.close(writing)
        os.waitpid(child, 0)


def _write(writing: int, octets: bytes) -> None:
    with suppress(BrokenPipeError):  # the guard itself was killed
        os.write(writing, octets)


def _guard(
    reading: int,
    settings: Settings,
    parameters: Path,
    ros_arguments: tuple[str, ...],
    rover_kind: Callable[..., RosVelocityRover | RosMotionRover],
) -> None:
    """Wait for the end of the process that holds the other end, and stop the rover if need be."""
    asset = settings.asset
    with ros_node(GUARD_NAME, asset, parameters=parameters, ros_arguments=ros_arguments) as node:
        rover = rover_kind(node, declare_topics(node), clock_of(node), settings)
        if os.read(reading, 1) == _WELL:
            return
        until_s, heard = time.monotonic() + DISCOVERY_S, False
        while time.monotonic() < until_s:
            if not heard and _is_heard(node, settings):
                until_s, heard = time.monotonic() + ZERO_S, True
            rover.emergency_stop()
            time.sleep(PAUSE_S)
        by = "" if heard else "; no mux was there to hear its lock"
        _LOG.error("the executive is gone: zero was published in its place%s", by)


def _is_heard(node: Node, settings: Settings) -> bool:
    """Return whether the mux hears its lock; without a mux the base stands by its own time-out."""
    mux = settings.mux
    if mux is None:
        return True
    return node.count_subscribers(node.resolve_topic_name(mux.locks[mux.lock].topic)) > 0
