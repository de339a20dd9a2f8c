"""`serve`, the body of `rover-executive`: assembles it, runs until a signal, closes it in order."""

import gc
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final, assert_never

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from sensor_msgs.msg import Image

from adapters.mal import MalUri
from adapters.mrs.link import MrsLink
from adapters.mrs.spec import ABOARD_HOUSEKEEPING, EXECUTIVE_HOUSEKEEPING
from adapters.mrs.transport import CLEAR, TransportSettings, start_fault
from adapters.onboard.guard import RUNS, Guard, guarded
from adapters.onboard.housekeeping import ExecutiveHousekeeping, HousekeepingProvider
from adapters.onboard.metrics import served
from adapters.onboard.planning import planning
from adapters.onboard.watchdog import Watchdog
from adapters.process import (
    ALIVE,
    StartError,
    Termination,
    announce,
    exclusive,
    notify,
    require,
    watchdog_period_s,
)
from adapters.recording import BackgroundRecorder
from adapters.ros import (
    NavigatedRosRover,
    RosAsset,
    RosMotionRover,
    RosNavigationRover,
    RosRover,
    RosVelocityRover,
    Topics,
    declare_sensor_topics,
    declare_topics,
    diagnostic_array,
    ros_node,
    single_threaded,
    steady_timer,
)
from adapters.ros.client_link import ReadCommandText, RosClientLink
from adapters.ros.node import ExecutiveNode, clock_of
from adapters.ros.simulation_items import record_simulation
from adapters.video import VideoForwarder
from executive.core.recording import RecordingTee
from executive.core.runner import Executive
from executive.goals import Context
from executive.history.history_builder import HistoryBuilder
from executive.motion import SharedSolver
from executive.record import Ledger, LedgerError
from executive.settings import LocomotionKind, RosCommands, Settings, SettingsError
from executive.values.clock import Clock
from executive.values.ports import Downlink, Video
from executive.values.reports import Severity
from trees import RoverTree, leaf_paths

NODE_NAME: Final = "executive"
LAST_STOP_S: Final = 0.5
LAST_STOPS: Final = 4
MAX_HISTORY: Final = 1000
"""Maximum number of commands, reports, modes and leaf executions in the history."""
BEATS_PER_TIMEOUT: Final = 2
"""Heartbeats of the core's thread within the watchdog's bound, if nothing else wakes it."""
ODOMETRY_TIMEOUT_S: Final = 3.0
"""Maximum wait for odometry before commands are served. DDS repeats a lost message of its discovery
after 1 s: at load 15 to 25, odometry was missing for 0.1 to 2.3 s after one start in three."""
GUARD_CHECK_S: Final = 1.0
"""Publication period of the guard's state."""
RECORDINGS: Final = "recordings"
"""Subfolder of the data folder."""
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ExecutiveOptions:
    """Options of the command line.

    Attributes:
        data: folder of ledger and files.
        parameters: ROS parameter file.
        ros_arguments: arguments passed to ROS unchanged.
        clear_text: whether the MRS may be served in clear text on an address other hosts reach.
        terms: encoding and certificates of the MRS link.
        service_layer: address of another service layer to register at; None for none.
        metrics: address of the metrics; None for none.
    """

    settings: Settings
    host: str
    port: int
    data: Path
    parameters: Path
    ros_arguments: tuple[str, ...]
    clear_text: bool = False
    terms: TransportSettings = CLEAR
    service_layer: MalUri | None = None
    relay: bool = False
    metrics: tuple[str, int] | None = None


def serve(
    options: ExecutiveOptions, build_tree: Callable[[Context], RoverTree] = RoverTree
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        options: options of the command line.
        build_tree: creates the tree.

    Raises:
        StartError: it cannot start.
        ParameterError: a ROS parameter or argument is invalid.
        SettingsError: the class of the rover is missing or does not fit.
    """
    settings = options.settings
    history = HistoryBuilder(leaf_paths, MAX_HISTORY)
    kind = rover_kind(settings)
    has_housekeeping = isinstance(kind, type) and issubclass(kind, HousekeepingProvider)
    parameters = ABOARD_HOUSEKEEPING if has_housekeeping else EXECUTIVE_HOUSEKEEPING
    housekeeping = ExecutiveHousekeeping(options.data, parameters)
    metrics = options.metrics
    termination = Termination()
    try:
        with (
            guarded(settings, options.parameters, options.ros_arguments, kind) as guard,
            exclusive(options.data, "lock"),
            ros_node(
                NODE_NAME,
                settings.asset,
                parameters=options.parameters,
                ros_arguments=options.ros_arguments,
            ) as node,
            single_threaded(node) as executor,
            closing(
                MrsLink(
                    settings,
                    options.host,
                    options.port,
                    options.clear_text,
                    options.terms,
                    options.service_layer,
                    history,
                    housekeeping,
                    options.data / RECORDINGS if settings.recording.enabled else None,
                )
            ) as link,
            served(housekeeping.count(settings, link), metrics) if metrics else nullcontext(),
            closing(VideoForwarder(settings.video)) if settings.video else nullcontext() as video,
            planning(settings) as solver,
            executive_on(
                node,
                settings,
                Ledger(options.data / "ledger.sqlite"),
                options.data / "files",
                [link],
                build_tree,
                video,
                options.relay,
                solver,
                options.data / RECORDINGS,
                history,
                housekeeping,
            ) as executive,
            watched(node, executive, guard) as watchdog,
        ):
            if guard is not None:
                guard.arm()
            until_s = time.monotonic() + ODOMETRY_TIMEOUT_S

            def spin_until(done: Callable[[], bool]) -> None:
                while not (termination.requested or done()):
                    executor.spin_once()
                    watchdog.beat()

            spin_until(lambda: executive.status.odometry_fresh or time.monotonic() > until_s)
            if not executive.status.odometry_fresh:
                warn_of_missing_odometry(node)
            announce(f"{settings.asset} listens at {_listen(link, executive, options)}")
            if (period_s := watchdog_period_s()) is not None:
                steady_timer(node, period_s, partial(notify, ALIVE))
            gc.freeze()
            spin_until(lambda: False)
            _LOG.info("termination requested: the rover stops, goals are cancelled")
    except LedgerError as error:
        raise StartError(str(error)) from error


def warn_of_missing_odometry(node: Node) -> None:
    """Log the topics of odometry, with the number of their publishers."""
    for each in node.subscriptions:
        if each.msg_type is Odometry:
            count = node.count_publishers(each.topic_name)
            text = "no odometry yet: %s has %d publishers (namespace: --ros-args -r __ns:=/NAME)"
            _LOG.warning(text, each.topic_name, count)


@contextmanager
def executive_on(
    node: Node,
    settings: Settings,
    ledger: Ledger,
    files: Path,
    downlinks: Sequence[Downlink],
    build_tree: Callable[[Context], RoverTree] = RoverTree,
    video: Video | None = None,
    relayed: bool = False,
    solver: SharedSolver | None = None,
    recordings: Path | None = None,
    history: HistoryBuilder | None = None,
    housekeeping: ExecutiveHousekeeping | None = None,
) -> Iterator[Executive]:
    """Yield an executive that a ROS node serves; the rover is stopped at the end.

    Args:
        node: serves it.
        settings: settings of the asset.
        ledger: its record.
        files: its folder of files.
        downlinks: downlinks in addition to the rover's own.
        build_tree: creates the tree.
        video: forwards its video stream.
        relayed: whether the relay link is served, too.
        solver: solver for mpc.
        recordings: folder of its recordings, if the settings enable them; None for none.
        history: collects the recent past for queries; None without queries.
        housekeeping: receives the tick statistics; None without queries.
    """
    topics, sensors = declare_topics(node), declare_sensor_topics(node, settings.sensors)
    if topics.camera is not None and topics.camera.type is Image:
        require("PIL")
    settings = replace(settings, sensors=sensors.without_topicless(settings.sensors))
    clock = clock_of(node)
    rover = rover_kind(settings)(node, topics, clock, settings)
    relay = None
    if relayed:
        from adapters.mops import load_dictionary
        from adapters.relay.rover.executive_link import ExecutiveRelayLink
        from adapters.relay.rover.executive_topics import ExecutiveRelayTopics

        relay_topics = ExecutiveRelayTopics(node)
        name = settings.asset.upper()
        relay = ExecutiveRelayLink(relay_topics, ledger, load_dictionary(), name)
    read_text: ReadCommandText | None = None
    if settings.ros.commands is not RosCommands.OFF:
        from adapters.mrs.cli import command_text

        read_text = command_text.read_command_text
    clients = RosClientLink(node, read_text)
    counted = None if housekeeping is None else housekeeping.metrics
    if counted is not None:
        counted.attach(ledger)
        downlinks = [*downlinks, counted]
    with recorded(settings, recordings) as tape:
        if history is not None:
            since = ledger.last_sequence - MAX_HISTORY + 1
            history.restore(ledger.reports(since, count=MAX_HISTORY))
        tapes = [each for each in (tape, history) if each is not None]
        executive = Executive(
            settings=settings,
            clock=clock,
            rover=rover,
            ledger=ledger,
            files=files,
            downlinks=[*downlinks, *rover.downlinks(ledger), *([relay] if relay else []), clients],
            build_tree=build_tree,
            video=video,
            solver=solver,
            tape=RecordingTee(*tapes) if tapes else None,
        )
        ledger.write_on_thread(lambda: executive.wake())
        if tape is not None:
            tape.on_fault = partial(_report_recording_fault, executive)
            record_simulation(node, tape, clock)
        served = ExecutiveNode(node, topics, sensors, rover, executive)
        if housekeeping is not None:
            served.on_ticks = housekeeping.note
            housekeeping.rover = rover if isinstance(rover, HousekeepingProvider) else None
        clients.serve(executive, served)
        if relay is not None:
            if housekeeping is not None:
                housekeeping.publish = relay.publish_housekeeping
            relay.serve(executive.submit, lambda: executive.mode, executive.plan_questions)
            relay_topics.serve(relay, served)
        with ExitStack() as ends:  # each also if one before it raises
            ends.callback(clients.close)
            ends.callback(_stop_until_acknowledged, rover)
            ends.callback(executive.close)
            ends.callback(served.close)
            yield executive


@contextmanager
def recorded(settings: Settings, folder: Path | None) -> Iterator[BackgroundRecorder | None]:
    """Yield the recorder of an executive; None if it is disabled or the folder cannot be used."""
    tape = None
    if folder is not None and settings.recording.enabled:
        try:
            tape = BackgroundRecorder(folder, settings.recording)
        except OSError as error:
            _LOG.warning("nothing is recorded: %s: %s", folder, error.strerror)
    with closing(tape) if tape is not None else nullcontext():
        yield tape


def _report_recording_fault(executive: Executive, text: str) -> None:
    executive.query(partial(executive.report_event, Severity.WARNING, text))


@contextmanager
def watched(node: Node, executive: Executive, guard: Guard | None = None) -> Iterator[Watchdog]:
    """Yield a watchdog over the thread that spins a node; publishes its alarms in /diagnostics.

    The heartbeat is independent of the tick, which pauses with simulated time. The death of a
    guard is reported and published there, too.
    """
    bound_s = executive.settings.safety.watchdog_s
    quiet = PublisherEventCallbacks(use_default_callbacks=False)  # each costs time in every spin
    diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1, event_callbacks=quiet)

    def publish(what: str, level: bytes, text: str, values: Mapping[str, object]) -> None:
        name, asset = f"{node.get_fully_qualified_name()}: {what}", executive.settings.asset
        stamp = node.get_clock().now().to_msg()
        diagnostics.publish(diagnostic_array(name, asset, level, text, values, stamp))

    def report(text: str) -> None:
        publish("watchdog", DiagnosticStatus.ERROR, text, {"bound [s]": f"{bound_s:g}"})

    def check_guard(guard: Guard) -> None:
        if text := guard.take_event():
            _LOG.error("%s", text)
            executive.report_event(Severity.ALARM, text)
        level = DiagnosticStatus.OK if guard.state == RUNS else DiagnosticStatus.WARN
        publish("guard", level, guard.state, {})

    with Watchdog(executive, bound_s, report) as watchdog:
        steady_timer(node, bound_s / BEATS_PER_TIMEOUT, watchdog.beat)
        if guard is not None:
            steady_timer(node, GUARD_CHECK_S, partial(check_guard, guard))
        yield watchdog


def _stop_until_acknowledged(rover: RosAsset) -> None:
    """Stop the rover until it acknowledges: after this process a lost stop is not repeated."""
    for _ in range(LAST_STOPS):
        rover.stop()
        if rover.flush(LAST_STOP_S):
            return
    _LOG.warning("the last stop was not acknowledged")


def _listen(link: MrsLink, executive: Executive, options: ExecutiveOptions) -> MalUri:
    try:
        return link.start(executive)
    except (ValueError, OSError) as error:
        host, what = options.host, f"listen at {options.host}:{options.port}"
        raise StartError(start_fault(error, what, host, " and --port")) from error


RosRoverKind = Callable[[Node, Topics, Clock, Settings], RosVelocityRover | RosMotionRover]
"""Creates the rover class from the node, the topics of every asset and the core's clock."""

FORM: Final = "module:Class, such as adapters.onboard.mocup:MocupOnRos"


def rover_kind(settings: Settings) -> RosRoverKind:
    """Return the class for an asset: the one in its settings, or that of rovers on `cmd_vel`.

    Raises:
        SettingsError: no such class exists, or it lacks methods for this `locomotion`; the text
            lists the existing classes, or the missing methods.
    """
    port = _port(settings)
    usual = RosRover if settings.navigation is None else NavigatedRosRover
    if settings.rover is None:
        if _missing(usual, port):
            raise SettingsError(
                f"{settings.asset}: locomotion {settings.locomotion.value} needs the key rover:"
                f" {FORM}"
            )
        return usual
    kind = _named(settings.rover, port)
    missing = _missing(kind, port)
    if missing:
        raise SettingsError(
            f"{settings.asset}: rover {settings.rover} lacks {', '.join(missing)}: with"
            f" locomotion {settings.locomotion.value} it must be a {port.__module__}."
            f"{port.__name__}"
        )
    return kind


def _port(settings: Settings) -> type:
    match settings.locomotion:
        case LocomotionKind.VELOCITY:
            return RosVelocityRover if settings.navigation is None else RosNavigationRover
        case LocomotionKind.DELEGATED:
            return RosMotionRover
        case _:
            assert_never(settings.locomotion)


def _named(name: str, port: type) -> type:
    path, _, kind = name.partition(":")
    if not (path and kind):
        raise SettingsError(
            f"rover {name!r} is not of the form {FORM}; a rover on cmd_vel needs no key rover"
        )
    try:
        module = import_module(path)
    except ImportError as error:
        raise SettingsError(
            f"rover {name}: {error}; the module must be installed with rover-executive, or"
            " be in a folder of PYTHONPATH"
        ) from error
    found = getattr(module, kind, None)
    if not isinstance(found, type):
        there = ", ".join(_classes_with_port(module, port)) or "none that fits"
        raise SettingsError(f"rover {name}: {path} has no class {kind!r}; there are: {there}")
    return found


def _classes_with_port(module: ModuleType, port: type) -> list[str]:
    """Return the names of a module's own classes that have all methods of a port."""
    return sorted(
        name
        for name, found in vars(module).items()
        if isinstance(found, type)
        and found.__module__ == module.__name__
        and not getattr(found, "_is_protocol", False)
        and not _missing(found, port)
    )


def _missing(kind: type, port: type) -> list[str]:
    """Return the methods of a port that a class lacks."""
    wanted = {
        name
        for base in port.__mro__
        for name, value in vars(base).items()
        if callable(value) and not name.startswith("_")
    }
    return sorted(name for name in wanted if not callable(getattr(kind, name, None)))
