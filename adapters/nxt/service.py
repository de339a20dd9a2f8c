"""Puts rover-nxt together, serves it until a signal, and takes it apart in the right order."""

import logging
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from usb.backend import IBackend

from adapters.mops.dictionary import load_dictionary
from adapters.nxt.brick import Brick
from adapters.nxt.node import NxtNode
from adapters.nxt.record import Record, RecordError
from adapters.nxt.settings import declare_settings
from adapters.process.folder import FolderError, exclusive
from adapters.process.signals import Termination
from adapters.ros.context import ros_node, single_threaded
from adapters.ros.parameters import declare_topics

NODE_NAME: Final = "nxt"
RECORD: Final = "nxt.sqlite"
LOCK: Final = "nxt.lock"
_LOG: Final = logging.getLogger(__name__)


class StartError(Exception):
    """It cannot start; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        asset: namespace of the rover.
        topics: ROS parameter file of the rover's topics.
        brick: ROS parameter file of the brick.
        data: folder of the record.
        ros_arguments: what goes to ROS as it is.
    """

    asset: str
    topics: Path
    brick: Path
    data: Path
    ros_arguments: tuple[str, ...]


def serve(options: Options, backend: IBackend) -> None:
    """Serve until SIGINT or SIGTERM; the brick is released on any way out.

    Args:
        options: what the command line says.
        backend: what speaks USB.

    Raises:
        adapters.ros.parameters.ParameterError: a ROS parameter or argument makes no sense.
        executive.settings.SettingsError: the MOPS dictionary does not fit.
        StartError: the folder or the record cannot be used.
    """
    asked = Termination()
    try:
        with exclusive(options.data, LOCK), closing(Record(options.data / RECORD)) as record:
            _serve(options, backend, record, asked)
    except (FolderError, RecordError) as error:
        raise StartError(str(error)) from error


def _serve(options: Options, backend: IBackend, record: Record, asked: Termination) -> None:
    dictionary = load_dictionary()
    with (
        ros_node(
            NODE_NAME,
            options.asset,
            parameters=options.topics,
            ros_arguments=("--params-file", str(options.brick), *options.ros_arguments),
        ) as node,
        single_threaded(node) as executor,
    ):
        topics, settings = declare_topics(node), declare_settings(node)
        address = settings.address
        served = NxtNode(
            node, topics, settings, dictionary, lambda: Brick(address, backend), record
        )
        with closing(served):
            print(f"{settings.brick} is served for {options.asset}, USB {address}", flush=True)
            while not asked.requested:
                executor.spin_once()
            _LOG.info("asked to end: the brick is released")
