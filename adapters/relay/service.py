"""Puts rover-relay together, serves it until a signal, and takes it apart in the right order."""

import fcntl
import logging
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from adapters.bundle.contact_plan import ContactPlan, read_plan
from adapters.bundle.errors import BundleError
from adapters.mops.dictionary import load_dictionary
from adapters.relay.link import RelayLink
from adapters.relay.node import RelayNode
from adapters.relay.settings import RelaySettings
from adapters.ros.context import ros_node, single_threaded
from adapters.ros.termination import Termination

NODE_NAME: Final = "relay"
_LOG: Final = logging.getLogger(__name__)


class StartError(Exception):
    """It cannot start, or cannot go on; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says.

    Attributes:
        asset: namespace of the rover.
        settings_file: where the settings were read; the contact plan is beside it.
        topics: ROS parameter file with the topics of the relay.
        data: folder of the store.
        ros_arguments: what goes to ROS as it is.
    """

    asset: str
    settings: RelaySettings
    settings_file: Path
    topics: Path
    data: Path
    ros_arguments: tuple[str, ...] = ()


def serve(options: Options) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises:
        StartError: it cannot start or go on.
        adapters.ros.parameters.ParameterError: a ROS parameter or argument makes no sense.
        executive.settings.SettingsError: the MOPS dictionary does not fit.
    """
    asked = Termination()
    settings = options.settings
    try:
        with (
            _exclusive(options.data),
            ros_node(
                NODE_NAME,
                options.asset,
                parameters=options.topics,
                ros_arguments=options.ros_arguments,
            ) as node,
            single_threaded(node) as executor,
        ):
            topics = RelayNode(node, settings.asset)
            store = options.data / "relay.sqlite"
            link = RelayLink(settings, store, _plan(options), load_dictionary(), topics)
            link.start()
            with closing(link), closing(topics):
                topics.listen(link.notify, lambda: link.health, lambda: link.refused)
                print(f"{settings.eid} relays for {settings.asset}", flush=True)
                while not asked.requested:
                    executor.spin_once()
                    if not link.alive:
                        raise StartError("the bundle agent is down; its error is in the log")
                _LOG.info("asked to end: what waits is kept")
    except (BundleError, OSError) as error:
        raise StartError(str(error)) from error


def _plan(options: Options) -> ContactPlan | None:
    """Return the contact plan; what is relative in it counts from now."""
    name = options.settings.contact_plan
    return None if name is None else read_plan(options.settings_file.parent / name, time.time())


@contextmanager
def _exclusive(folder: Path) -> Iterator[None]:
    """Hold the store; the kernel lets go of it however this process ends."""
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "relay.lock").open("a") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StartError(
                f"another rover-relay works in {folder}: stop it, or give this one a folder of its"
                " own with --data"
            ) from error
        yield
