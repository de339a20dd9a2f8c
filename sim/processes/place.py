"""Where processes meet: a ROS domain and a TCP port that nobody else uses.

A place where another rover is, is refused.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Final

from adapters.mrs.spec import PORT

HOST: Final = "127.0.0.1"
ANY_PORT: Final = 0
DOMAINS: Final = range(101, 0, -1)
"""Higher ids overlap the ports that Linux hands out; most people take the lowest."""
LAST_DOMAIN: Final = 232
RESERVATION_PORT: Final = 22119
"""As ROS's domain_coordinator does it, so that tests and people keep apart."""

DISCOVERY_PORT: Final = 7400
DISCOVERY_PORTS: Final = 250
"""Of DDS: the first, and how many each domain has (DDSI-RTPS 9.6.1.1)."""


class AddressError(Exception):
    """Another rover is there; the text says where and what to do."""


@dataclass(frozen=True, slots=True)
class RoverAddress:
    """Where the processes meet.

    Attributes:
        domain: ROS domain id.
        port: TCP port of the MRS link; 0 for a free one, which the executive tells.
        shared: whether others are in the domain already.
    """

    domain: int
    port: int
    shared: bool

    def beside(self, number: int) -> "RoverAddress":
        """Return the place of one more rover in the same domain, at the port after so many."""
        return self if self.port == ANY_PORT else replace(self, port=self.port + number)


def known_place() -> RoverAddress:
    """Return where `rover command`, `rover status` and `rover watch` look without options.

    Raises:
        PlaceError: something listens there, or ROVER_URI or ROS_DOMAIN_ID does not allow it.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdecimal() and int(domain) <= LAST_DOMAIN):
        raise AddressError(f"ROS_DOMAIN_ID is {domain!r}: a domain is 0 to {LAST_DOMAIN}")
    port = _known_port()
    if not is_free(port):
        raise AddressError(
            f"port {port} of {HOST} is taken, probably by another rover. End that one, or play"
            " without --stay, which takes a port of its own."
        )
    return RoverAddress(int(domain), port, shared=not _is_empty(int(domain)))


def _known_port() -> int:
    address = os.environ.get("ROVER_URI")
    if not address:
        return PORT
    from adapters.mrs.ground import parse_address

    try:
        uri = parse_address(address)
    except ValueError as error:
        raise AddressError(f"ROVER_URI: {error}") from error
    if uri.host not in (HOST, "localhost"):
        raise AddressError(
            f"ROVER_URI is {address}: that is where `rover command` looks, and a simulated rover"
            f" stays on {HOST}. Unset ROVER_URI, or play without --stay."
        )
    return uri.port


@contextmanager
def free_place() -> Iterator[RoverAddress]:
    """Hold a ROS domain that nobody uses, with any port.

    Raises:
        PlaceError: all domains are in use.
    """
    with ExitStack() as held:
        for domain in DOMAINS:
            reservation = held.enter_context(socket.socket())
            try:
                reservation.bind((HOST, RESERVATION_PORT + domain))
            except OSError:
                continue
            if _is_empty(domain):
                yield RoverAddress(domain, ANY_PORT, shared=False)
                return
    raise AddressError("every ROS domain from 1 to 101 is in use on this machine")


def is_free(port: int) -> bool:
    """Return whether nobody listens at a TCP port of this computer."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def free_udp_ports(count: int) -> list[int]:
    """Return UDP ports that nobody has, for processes that must know each other's beforehand."""
    with ExitStack() as held:
        probes = [held.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(count)]
        for probe in probes:
            probe.bind((HOST, ANY_PORT))
        return [int(probe.getsockname()[1]) for probe in probes]


def _is_empty(domain: int) -> bool:
    """Return whether no participant on this machine listens for others of a ROS domain."""
    with socket.socket(type=socket.SOCK_DGRAM) as discovery:
        try:
            discovery.bind(("", DISCOVERY_PORT + DISCOVERY_PORTS * domain))
        except OSError:
            return False
    return True
