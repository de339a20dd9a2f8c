"""`check_robot` checks a robot that runs: listens, drives on request, judges the received data."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rclpy.node import Node

from adapters.ros.check.advice import Advice, TopicResult, advise, edits
from adapters.ros.check.drive import DriveError, announcement, check_drivable, drive
from adapters.ros.check.figures import Arrived, Figures, figures
from adapters.ros.check.listening import DRIVEN, Listening
from adapters.ros.context import ros_node, single_threaded
from executive.settings import FileEdit, Settings, asset_file, load_settings, ros_parameter_file

NODE_NAME: Final = "robot_check"
NO_ROBOT: Final = (
    "no node has any of these topics: does `ros2 topic list` show them with this ROS_DOMAIN_ID and"
    " ROS_AUTOMATIC_DISCOVERY_RANGE, and is the namespace right (--namespace)?"
)


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The result of a check.

    Attributes:
        faults: faults of the monitors in a bag, as text.
        changes: files of the asset to change.
        fits: whether there is no problem.
    """

    asset: str
    topics: tuple[TopicResult, ...]
    figures: Figures
    advices: tuple[Advice, ...]
    faults: tuple[str, ...]
    changes: tuple[FileEdit, ...]
    fits: bool


def check_robot(
    asset: str, seconds: float, namespace: str | None, on_drive: Callable[[str], None] | None
) -> CheckResult:
    """Check a robot that runs.

    Args:
        asset: its name or file.
        seconds: time of listening.
        namespace: ROS namespace of the robot; None: the asset's name.
        on_drive: called before the drive with its announcement; None: the robot does not move.

    Raises:
        SettingsError: the files of the asset are invalid.
        DriveError: the drive is not possible, or was ended.
    """
    settings = load_settings(asset)
    if on_drive is not None:
        check_drivable(settings)
    with asset_node(asset, settings, namespace) as node, single_threaded(node) as executor:
        listening = Listening(node, settings)
        listening.listen(executor, seconds)
        if on_drive is not None:
            needed = [each for each in listening.results() if each.key in DRIVEN]
            problems = [f"{each.key}: {text}" for each in needed for text in each.problems]
            problems += [f"{each} publishes velocities, too" for each in listening.publishers()]
            if problems:
                raise DriveError(f"it is not driven: {'; '.join(dict.fromkeys(problems))}")
            on_drive(announcement(settings))
            drive(node, executor, settings, listening)
        topics = listening.results()
        notes = [] if any(each.peers for each in topics) else [Advice(NO_ROBOT, is_problem=True)]
        return result(asset, settings, topics, listening.facts, notes=notes)


@contextmanager
def asset_node(asset: str, settings: Settings, namespace: str | None) -> Iterator[Node]:
    """Yield a node with the parameter file of an asset, in the namespace of its robot."""
    _, parameters = _files(asset, settings)
    with ros_node(NODE_NAME, namespace or settings.asset, parameters=parameters) as node:
        yield node


def _files(asset: str, settings: Settings) -> tuple[Path, Path]:
    """Return the files of an asset: settings and ROS parameters."""
    own = asset_file(asset)
    return own, ros_parameter_file(settings.asset, own.parent)


def result(
    asset: str,
    settings: Settings,
    topics: tuple[TopicResult, ...],
    facts: Iterable[Arrived[Any]],
    faults: tuple[str, ...] = (),
    notes: Iterable[Advice] = (),
) -> CheckResult:
    """Return the result for the received data."""
    found = figures(facts, settings.sensors.joints)
    advices = (*notes, *advise(settings, topics, found))
    # Without a node of the robot no optional topic is left out.
    present = any(each.peers for each in topics)
    changes = [each for topic in topics for each in topic.changes if present or each.value]
    changes += [change for each in advices for change in each.changes]
    problems = any(each.problems for each in topics) or any(each.is_problem for each in advices)
    return CheckResult(
        settings.asset,
        topics,
        found,
        advices,
        faults,
        edits(*_files(asset, settings), changes),
        not problems and not faults,
    )
