"""Puts rover-relay together, serves it until a signal, and takes it apart in the right order."""

import logging
import signal
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from adapters.bundle import BundleError, ContactPlan, listen_error, load_contact_plan
from adapters.mops.dictionary import load_dictionary
from adapters.process.folder import FolderError, exclusive
from adapters.process.signals import Termination
from adapters.relay.link import RelayLink
from adapters.relay.node import RelayNode
from adapters.relay.settings import RelaySettings
from adapters.ros.context import ros_node, single_threaded

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
    asked, asked_again = Termination(), list[int]()
    signal.signal(signal.SIGUSR1, lambda number, _: asked_again.append(number))
    settings = options.settings
    try:
        with (
            exclusive(options.data, "relay.lock"),
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
            read_plan = partial(
                load_contact_plan,
                *(options.settings_file, settings.contact_plan, options.data, settings.node()),
            )
            link = RelayLink(settings, store, read_plan(), load_dictionary(), topics)
            _start(link, options)
            with closing(link), closing(topics):
                topics.listen(
                    link.notify,
                    *(lambda: link.health, lambda: link.agent_health, lambda: link.refused),
                )
                print(f"{settings.eid} relays for {settings.asset}", flush=True)
                while not asked.requested:
                    executor.spin_once()
                    if asked_again:
                        asked_again.clear()
                        _read_again(link, read_plan)
                    if not link.alive:
                        raise StartError("the bundle agent is down; its error is in the log")
                _LOG.info("asked to end: what waits is kept")
    except (BundleError, FolderError, OSError) as error:
        raise StartError(str(error)) from error


def _read_again(link: RelayLink, read_plan: Callable[[], ContactPlan | None]) -> None:
    """Go by the plan as it is in the file now; one that is broken changes nothing."""
    try:
        link.set_plan(read_plan())
        _LOG.info("asked to read the contact plan again")
    except (BundleError, OSError) as error:
        _LOG.error("the contact plan stays as it was: %s", error)


def _start(link: RelayLink, options: Options) -> None:
    try:
        link.start()
    except OSError as error:
        why = listen_error(error, options.settings.listen, options.settings_file)
        raise StartError(why) from error
