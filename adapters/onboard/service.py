"""Puts an executive together, serves it until a signal, and takes it apart in the right order."""

import gc
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Final, assert_never

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node

from adapters.mal import MalUri
from adapters.mops import load_dictionary
from adapters.mrs.link import MrsLink
from adapters.mrs.spec import ABOARD_HOUSEKEEPING, EXECUTIVE_HOUSEKEEPING
from adapters.mrs.terms import CLEAR, TransportSettings, start_fault
from adapters.onboard.guard import RUNS, Guard, guarded
from adapters.onboard.housekeeping import ExecutiveHousekeeping, HousekeepingProvider
from adapters.onboard.planning import planning
from adapters.onboard.watchdog import Watchdog
from adapters.process import StartError, Termination, exclusive
from adapters.recording import BackgroundRecorder
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from adapters.relay.rover.executive_topics import ExecutiveRelayTopics
from adapters.ros import (
    RosAsset,
    RosMotionRover,
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
from adapters.ros.node import ExecutiveNode, clock_of
from adapters.video import VideoForwarder
from executive.core.recording import Tapes
from executive.core.runner import Executive
from executive.goals import Context
from executive.history import HistoryBuilder
from executive.motion import SharedSolver
from executive.record import Ledger, LedgerError
from executive.settings import LocomotionKind, Settings, SettingsError
from executive.values.clock import Clock
from executive.values.ports import Downlink, Video
from executive.values.reports import Severity
from trees import RoverTree, leaf_paths

NODE_NAME: Final = "executive"
LAST_STOP_S: Final = 0.5
LAST_STOPS: Final = 4
MOST_REMEMBERED: Final = 1000
"""Commands, reports, modes and runs of leaves that can be asked for."""
BEATS: Final = 2
"""Of the core's thread within the watchdog's bound, where nothing else wakes it."""
GUARD_CHECK_S: Final = 1.0
"""Period in which the state of the guard is read and published."""
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class ExecutiveOptions:
    """What the command line says.

    Attributes:
        data: folder of ledger and files.
        parameters: the ROS parameter file.
        ros_arguments: what goes to ROS as it is.
        clear_text: whether the MRS may be served in clear text where others can reach it.
        terms: the encoding and the certificates of the MRS link.
        service_layer: where another service layer is, to be registered at; None for nowhere.
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


def serve(
    options: ExecutiveOptions, build_tree: Callable[[Context], RoverTree] = RoverTree
) -> None:
    """Serve until SIGINT or SIGTERM.

    Args:
        options: what the command line says.
        build_tree: makes the tree.

    Raises:
        StartError: it cannot start.
        ParameterError: a ROS parameter or argument makes no sense.
        SettingsError: the class that speaks with the rover is not there, or does not fit.
    """
    settings = options.settings
    history = HistoryBuilder(leaf_paths, MOST_REMEMBERED)
    kind = rover_kind(settings)
    tells = isinstance(kind, type) and issubclass(kind, HousekeepingProvider)
    parameters = ABOARD_HOUSEKEEPING if tells else EXECUTIVE_HOUSEKEEPING
    housekeeping = ExecutiveHousekeeping(options.data, parameters)
    asked = Termination()
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
                )
            ) as link,
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
                options.data / "recordings",
                history,
                housekeeping,
            ) as executive,
            watched(node, executive, guard) as watchdog,
        ):
            print(f"{settings.asset} listens at {_listen(link, executive, options)}", flush=True)
            if guard is not None:
                guard.arm()
            gc.freeze()
            while not asked.requested:
                executor.spin_once()
                watchdog.beat()
            _LOG.info("asked to end: the rover stands, goals are cancelled")
    except LedgerError as error:
        raise StartError(str(error)) from error


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
    """Yield an executive that a ROS node serves; at the end the rover stands.

    Args:
        node: serves it.
        settings: of the asset.
        ledger: its record.
        files: its folder of files.
        downlinks: the ways out beside the rover's own.
        build_tree: makes the tree.
        video: forwards its video stream.
        relayed: whether the relay link is served, too.
        solver: plans for mpc.
        recordings: the folder that its recordings are kept in, if the settings want any; None for
            none.
        history: takes what can be asked for of the recent past; None if nobody will ask.
        housekeeping: takes how regular the ticks are; None if nobody will ask.
    """
    topics, sensors = declare_topics(node), declare_sensor_topics(node, settings.sensors)
    settings = replace(settings, sensors=sensors.without_topicless(settings.sensors))
    clock = clock_of(node)
    rover = rover_kind(settings)(node, topics, clock, settings)
    relay = None
    if relayed:
        relay_topics = ExecutiveRelayTopics(node)
        name = settings.asset.upper()
        relay = ExecutiveRelayLink(relay_topics, ledger, load_dictionary(), name)
    with recorded(settings, recordings) as tape:
        if history is not None:
            since = ledger.last_sequence - MOST_REMEMBERED + 1
            history.restore(ledger.reports(since, count=MOST_REMEMBERED))
        tapes = [each for each in (tape, history) if each is not None]
        executive = Executive(
            settings=settings,
            clock=clock,
            rover=rover,
            ledger=ledger,
            files=files,
            downlinks=[*downlinks, *rover.downlinks(ledger), *([relay] if relay else [])],
            build_tree=build_tree,
            video=video,
            solver=solver,
            tape=Tapes(*tapes) if tapes else None,
        )
        if tape is not None:
            tape.tell = partial(_tell_of_recording, executive)
        served = ExecutiveNode(node, topics, sensors, rover, executive)
        if housekeeping is not None:
            served.on_ticks = housekeeping.note
            housekeeping.rover = rover if isinstance(rover, HousekeepingProvider) else None
        if relay is not None:
            if housekeeping is not None:
                housekeeping.tell = relay.housekeeping
            relay.serve(executive.submit, lambda: executive.mode)
            relay_topics.serve(relay, served)
        try:
            yield executive
        finally:
            served.close()
            executive.close()
            if not _stop_until_acknowledged(rover):
                _LOG.warning("the last stop was not acknowledged")


@contextmanager
def recorded(settings: Settings, folder: Path | None) -> Iterator[BackgroundRecorder | None]:
    """Yield what takes the recording of an executive; None where there is to be none, or cannot be.

    Args:
        settings: of the asset.
        folder: of its recordings.
    """
    tape = None
    if folder is not None and settings.recording.enabled:
        try:
            tape = BackgroundRecorder(folder, settings.recording)
        except OSError as error:
            _LOG.warning("nothing is recorded: %s: %s", folder, error.strerror)
    with closing(tape) if tape is not None else nullcontext():
        yield tape


def _tell_of_recording(executive: Executive, text: str) -> None:
    executive.ask(partial(executive.event, Severity.WARNING, text))


@contextmanager
def watched(node: Node, executive: Executive, guard: Guard | None = None) -> Iterator[Watchdog]:
    """Yield a watchdog over the thread that spins a node; it shows its alarms in /diagnostics.

    The beat does not come with the tick, which stands still with simulated time. The death of a
    guard is reported, and shown there, too.
    """
    bound_s = executive.settings.safety.watchdog_s
    quiet = PublisherEventCallbacks(use_default_callbacks=False)  # each costs in every turn
    diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 1, event_callbacks=quiet)

    def publish(what: str, level: bytes, text: str, values: Mapping[str, object]) -> None:
        name, asset = f"{node.get_fully_qualified_name()}: {what}", executive.settings.asset
        stamp = node.get_clock().now().to_msg()
        diagnostics.publish(diagnostic_array(name, asset, level, text, values, stamp))

    def tell(text: str) -> None:
        publish("watchdog", DiagnosticStatus.ERROR, text, {"bound [s]": f"{bound_s:g}"})

    def check_guard(guard: Guard) -> None:
        if text := guard.take_event():
            _LOG.error("%s", text)
            executive.event(Severity.ALARM, text)
        level = DiagnosticStatus.OK if guard.state == RUNS else DiagnosticStatus.WARN
        publish("guard", level, guard.state, {})

    with Watchdog(executive, bound_s, tell) as watchdog:
        steady_timer(node, bound_s / BEATS, watchdog.beat)
        if guard is not None:
            steady_timer(node, GUARD_CHECK_S, partial(check_guard, guard))
        yield watchdog


def _stop_until_acknowledged(rover: RosAsset) -> bool:
    """Stop the rover until it confirms: after this process ends, a lost stop is not repeated."""
    for _ in range(LAST_STOPS):
        rover.stand()
        if rover.flush(LAST_STOP_S):
            return True
    return False


def _listen(link: MrsLink, executive: Executive, options: ExecutiveOptions) -> MalUri:
    try:
        return link.start(executive)
    except (ValueError, OSError) as error:
        host, what = options.host, f"listen at {options.host}:{options.port}"
        raise StartError(start_fault(error, what, host, " and --port")) from error


RosRoverKind = Callable[[Node, Topics, Clock, Settings], RosVelocityRover | RosMotionRover]
"""Makes what speaks with a rover: of the node, the topics of every asset, the core's clock."""

FORM: Final = "module:Class, such as adapters.onboard.mocup:MocupOnRos"


def rover_kind(settings: Settings) -> RosRoverKind:
    """Return the class for an asset: the one that it names, or that of rovers on `cmd_vel`.

    Raises:
        SettingsError: there is none of that name, or the rover cannot be moved by it in the way
            that `locomotion` says; the text says which there are, or what it lacks.
    """
    port = _port(settings.locomotion)
    if settings.rover is None:
        if _missing(RosRover, port):
            raise SettingsError(
                f"{settings.asset}: locomotion {settings.locomotion.value} needs the key rover:"
                f" {FORM}"
            )
        return RosRover
    kind = _named(settings.rover, port)
    missing = _missing(kind, port)
    if missing:
        raise SettingsError(
            f"{settings.asset}: rover {settings.rover} lacks {', '.join(missing)}: with"
            f" locomotion {settings.locomotion.value} it has to be a {port.__module__}."
            f"{port.__name__}"
        )
    return kind


def _port(way: LocomotionKind) -> type:
    match way:
        case LocomotionKind.VELOCITY:
            return RosVelocityRover
        case LocomotionKind.WHOLE_MOTION:
            return RosMotionRover
        case _:
            assert_never(way)


def _named(name: str, port: type) -> type:
    place, _, kind = name.partition(":")
    if not (place and kind):
        raise SettingsError(
            f"rover {name!r} is not of the form {FORM}; a rover on cmd_vel needs no key rover"
        )
    try:
        module = import_module(place)
    except ImportError as error:
        raise SettingsError(
            f"rover {name}: {error}; the module has to be installed beside rover-executive, or to"
            " lie in a folder of PYTHONPATH"
        ) from error
    found = getattr(module, kind, None)
    if not isinstance(found, type):
        there = ", ".join(_fitting(module, port)) or "none that could be it"
        raise SettingsError(f"rover {name}: {place} has no class {kind!r}; there are: {there}")
    return found


def _fitting(module: ModuleType, port: type) -> list[str]:
    """Return the names of a module's own classes that have all that a port asks for."""
    return sorted(
        name
        for name, found in vars(module).items()
        if isinstance(found, type)
        and found.__module__ == module.__name__
        and not getattr(found, "_is_protocol", False)
        and not _missing(found, port)
    )


def _missing(kind: type, port: type) -> list[str]:
    """Return the methods of a port that a class does not have."""
    wanted = {
        name
        for base in port.__mro__
        for name, value in vars(base).items()
        if callable(value) and not name.startswith("_")
    }
    return sorted(name for name in wanted if not callable(getattr(kind, name, None)))
