"""The settings block of an application that sends bundles, and the agent made from it."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial
from pathlib import Path

from adapters.bundle.agent import BundleAgent
from adapters.bundle.codec.eid import Eid, is_null, parse_eid
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.links.contact import ContactPlan
from adapters.bundle.node.database import Synchronous
from adapters.bundle.node.settings import (
    NO_ADDRESSES,
    AnyLink,
    DaemonLink,
    IonSettings,
    Listen,
    LtpLink,
    NodeSettings,
    TcpclLink,
    UdpLink,
)


class Agent(Enum):
    """Who sends and receives: links of the agent, or NASA ION on the same machine."""

    EMBEDDED = "embedded"
    ION = "ion"


@dataclass(frozen=True, slots=True, kw_only=True)
class Application:
    """An application that sends and receives.

    Attributes:
        eid: where it receives, and from where it sends.
    """

    eid: str

    def __post_init__(self) -> None:
        try:
            null = is_null(self.endpoint)
        except ValueError as error:
            raise ValueError(f"eid: {error}") from error
        if null:
            raise ValueError(f"eid: {self.eid} is the null endpoint")

    @property
    def endpoint(self) -> Eid:
        """The EID as a value."""
        return parse_eid(self.eid)


@dataclass(frozen=True, slots=True, kw_only=True)
class Peer(Application):
    """Another application, and how the agent of its node is reached.

    Attributes:
        ltp, tcpcl, udp: one of them; none where a daemon reaches it.
    """

    ltp: LtpLink | None = None
    tcpcl: TcpclLink | None = None
    udp: UdpLink | None = None

    @property
    def links(self) -> dict[str, LtpLink | TcpclLink | UdpLink]:
        """The links that are given, by their keys."""
        links = {"ltp": self.ltp, "tcpcl": self.tcpcl, "udp": self.udp}
        return {key: link for key, link in links.items() if link is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class AgentSettings(Application):
    """The application's own side: the agent of its node.

    Attributes:
        listen: where others reach this node, for each protocol that is spoken.
        contact_plan: the file of planned contacts, beside this one; None for always.
        agent: who sends and receives the bundles; ion: how that node is reached.
    """

    listen: Listen = NO_ADDRESSES
    contact_plan: str | None = None
    agent: Agent = Agent.EMBEDDED
    ion: IonSettings | None = None

    @property
    def daemon(self) -> IonSettings | None:
        """The node of ION that sends and receives; None where the agent has links of its own.

        Raises:
            ValueError: there are settings of ION, and it is not asked for.
        """
        if self.agent is Agent.ION:
            return self.ion or IonSettings()
        if self.ion is not None:
            raise ValueError(
                f"agent is {self.agent.value}, and there are settings of another: remove section"
                " ion, or say agent: ion"
            )
        return None

    def link_to(self, other: Peer, name: str) -> AnyLink:
        """Return the link to a peer: the one that its settings give, or the daemon's.

        Args:
            other: the other.
            name: what it is called in errors.

        Raises:
            ValueError: there are too many, or none, or bundles could not go by it both ways.
        """
        links, daemon = other.links, self.daemon
        if daemon is not None:
            self._leave_to_daemon(other, name)
            return DaemonLink(other.endpoint, daemon.whole)
        if len(links) != 1:
            given = f"it has {' and '.join(links)}, keep one" if links else "give it one"
            raise ValueError(f"{name} is reached by one of ltp, tcpcl, udp: {given}")
        ((key, link),) = links.items()
        if link.address is not None and link.address.port == 0:
            raise ValueError(f"{key}.address of {name} has port 0: say where it listens")
        if link.address is None and self.listen.tcpcl is None:
            raise ValueError(
                f"tcpcl.address of {name} is null, and section listen has no tcpcl: neither could"
                " call the other, give one of them"
            )
        if not isinstance(link, TcpclLink) and getattr(self.listen, key) is None:
            raise ValueError(
                f"section listen lacks {key}, by which {name} is reached, and which sends from"
                f" where it listens: give listen.{key} the host and port that {name} has for us"
            )
        return link

    def _leave_to_daemon(self, other: Peer, name: str) -> None:
        agent = f"agent is {self.agent.value}, a daemon that"
        if other.links:
            raise ValueError(
                f"{agent} reaches {name}: remove {' and '.join(other.links)} of {name}, and section"
                " listen"
            )
        if self.listen != NO_ADDRESSES:
            raise ValueError(f"{agent} listens itself: remove section listen")


def make_agent(
    settings: NodeSettings,
    path: Path,
    daemon: IonSettings | None = None,
    listen: Listen | None = None,
    plan: ContactPlan | None = None,
    utc_s: Callable[[], float] = time.time,
    synchronous: Synchronous = Synchronous.FULL,
) -> BundleAgent:
    """Return an agent with links of its own, or attached to a node of ION.

    Args:
        settings: its EIDs and neighbours.
        path: the file of its store.
        daemon: the node of ION that sends and receives for it; None for its own links.
        listen: where others reach its own links.
        plan: contacts, by ION's node numbers; None for always.
        utc_s: the time in seconds since 1970.
        synchronous: how far a commit goes.

    Raises:
        BundleError: a package is missing; the text says which, and how to have it.
    """
    if daemon is None:
        return BundleAgent(settings, path, listen, plan, utc_s, synchronous)
    if settings.receivers != (settings.sender,):
        raise BundleError(f"a daemon has {settings.sender} receive and send, and no other endpoint")
    from adapters.bundle.daemons.ion_client import IonClient

    attach = partial(IonClient, daemon)
    return BundleAgent(settings, path, listen, plan, utc_s, synchronous, attach)


def listen_error(error: OSError, listen: Listen, settings_file: Path) -> str:
    """Return why an agent cannot listen, and what to do."""
    addresses = (listen.ltp, listen.tcpcl, listen.udp)
    where = ", ".join(f"{each.host}:{each.port}" for each in addresses if each is not None)
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    return (
        f"cannot listen for bundles at {where}: {why}; choose another address in section listen of"
        f" {settings_file}, and tell it to the other end"
    )
