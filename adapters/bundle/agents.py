"""Makes the agent that a settings file asks for."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import assert_never

from adapters.bundle.attached.daemon import Daemon
from adapters.bundle.attached.settings import Aap2Settings, DaemonSettings, IonSettings
from adapters.bundle.contact_plan import ContactPlan
from adapters.bundle.database import Synchronous
from adapters.bundle.embedded import EmbeddedAgent
from adapters.bundle.errors import BundleError
from adapters.bundle.links import Listen
from adapters.bundle.settings import NodeSettings


def make_agent(
    settings: NodeSettings,
    path: Path,
    daemon: DaemonSettings | None = None,
    listen: Listen | None = None,
    plan: ContactPlan | None = None,
    utc_s: Callable[[], float] = time.time,
    synchronous: Synchronous = Synchronous.FULL,
) -> EmbeddedAgent:
    """Return an agent over its own links, or attached to a daemon; store and promises are the same.

    Args:
        settings: its EIDs and neighbours.
        path: the file of its store.
        daemon: who carries for it; None for its own links.
        listen: where others reach its own links.
        plan: contacts, by ION's node numbers; None for always.
        utc_s: the time in seconds since 1970.
        synchronous: how far a commit goes.

    Raises:
        BundleError: a package is missing; the text says which, and how to have it.
    """
    attached = None if daemon is None else _attached(daemon, settings, path)
    return EmbeddedAgent(settings, path, listen, plan, utc_s, synchronous, attached)


def _attached(daemon: DaemonSettings, settings: NodeSettings, path: Path) -> Daemon:
    if settings.receivers != (settings.sender,):
        raise BundleError(f"a daemon has {settings.sender} receive and send, and no other endpoint")
    match daemon:
        case IonSettings():
            from adapters.bundle.ion.client import IonDaemon

            return IonDaemon(daemon, settings.sender, path.with_suffix(".received"))
        case Aap2Settings():
            try:
                from adapters.bundle.aap2.client import Aap2Daemon
            except ModuleNotFoundError as error:
                raise BundleError(
                    f"an agent attached to a uD3TN daemon needs the package ud3tn-utils: {error}."
                    " Install it: pip install 'rover-executive[aap2]'"
                ) from error
            return Aap2Daemon(daemon, settings.sender, settings.most_payload_octets)
        case _:
            assert_never(daemon)
