"""`ros_node` and other context managers: a ROS node with its settings, and a clean end.

The process keeps its signal handlers: those of rclpy would shut ROS down before a last zero
velocity could be published.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import rclpy
from rclpy.clock import Clock as NodeClock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from adapters.process import ROS_ARGS
from adapters.ros.parameters import ParameterError
from executive.settings import config_folder

_PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
"""Fast DDS 2 (Jazzy) reads the first name alone; with Fast DDS 3 it is deprecated."""
_TRANSPORT_CHOICES = (
    *_PROFILES,
    "FASTDDS_BUILTIN_TRANSPORTS",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_DISCOVERY_SERVER",
    "ROS_DISTRO",
)


@contextmanager
def ros_node(
    name: str,
    namespace: str,
    *,
    parameters: Path | None = None,
    ros_arguments: Sequence[str] = (),
    domain_id: int | None = None,
) -> Iterator[Node]:
    """Yield a node without parameter services, in a context of its own.

    Args:
        name: name of the node.
        namespace: namespace of its relative names.
        parameters: a ROS parameter file.
        ros_arguments: user arguments after `--ros-args`; they override the file.
        domain_id: ROS domain; None selects ROS_DOMAIN_ID.

    Raises:
        ParameterError: ROS refuses the parameter file, an argument or a name.
    """
    _stay_on_loopback()
    arguments = [ROS_ARGS, "--disable-rosout-logs", "--disable-external-lib-logs"]
    if parameters is not None:
        arguments += ["--params-file", str(parameters)]
    context = Context()
    try:
        rclpy.init(
            args=[*arguments, *ros_arguments],
            context=context,
            domain_id=domain_id,
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except RuntimeError as error:
        raise ParameterError(f"ROS does not start: {error}") from error
    try:
        try:
            node = Node(
                name,
                namespace=namespace,
                context=context,
                enable_rosout=False,
                start_parameter_services=False,
            )
        except NameValidationException as error:
            raise ParameterError(f"{namespace!r} is not a valid ROS name: {error}") from error
        try:
            yield node
        finally:
            node.destroy_node()  # type: ignore[no-untyped-call]
    finally:
        context.try_shutdown()


@contextmanager
def single_threaded(node: Node) -> Iterator[SingleThreadedExecutor]:
    """Yield an executor that serves the node on the calling thread."""
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    try:
        yield executor
    finally:
        executor.shutdown()


class SpunNode:
    """A second node in another one's namespace, spun by a thread of its own until it is closed."""

    def __init__(self, name: str, beside: Node) -> None:
        self.node = Node(
            name,
            namespace=beside.get_namespace(),
            context=beside.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=beside.context)
        self._executor.add_node(self.node)
        self._closing = False
        self._woken = self.node.create_guard_condition(lambda: None)
        self._thread = Thread(target=self._spin, name=name)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread, then destroy the node."""
        self._closing = True
        self._woken.trigger()  # type: ignore[no-untyped-call]
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()  # type: ignore[no-untyped-call]

    def _spin(self) -> None:
        while not self._closing:
            self._executor.spin_once()


def steady_timer(node: Node, period_s: float, callback: Callable[[], None]) -> None:
    """Call a callback periodically by the steady clock, independent of simulated time."""
    node.create_timer(period_s, callback, clock=NodeClock(clock_type=ClockType.STEADY_TIME))


def subscribers_of(node: Node, publisher: Publisher) -> frozenset[bytes]:
    """Return the endpoint ids (GID) of the subscribers to a publisher's topic."""
    found = node.get_subscriptions_info_by_topic(publisher.topic_name)
    return frozenset(bytes(each.endpoint_gid) for each in found)


def _stay_on_loopback() -> None:
    """Use the transports of the `rover` launcher, unless the environment configures others."""
    profile = config_folder() / "fastdds.xml"
    if not any(os.environ.get(name) for name in _TRANSPORT_CHOICES) and profile.is_file():
        os.environ.update(dict.fromkeys(_PROFILES, str(profile)))
