"""Allocates addresses of a rover's processes: a ROS domain and a TCP port that no other one uses.

An address in use by another rover is refused.
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
"""Domain ids to try: higher ids overlap the ephemeral ports of Linux; users often take low ones."""
LAST_DOMAIN: Final = 232
RESERVATION_PORT: Final = 22119
"""Port as in ROS's domain_coordinator, so that tests and users do not collide."""

DISCOVERY_PORT: Final = 7400
DISCOVERY_PORTS: Final = 250
"""First port of DDS, and number of ports of each domain (DDSI-RTPS 9.6.1.1)."""


class AddressError(Exception):
    """Another rover uses the address; the text gives it and the remedy."""


@dataclass(frozen=True, slots=True)
class RoverAddress:
    """Address of the processes.

    Attributes:
        domain: ROS domain id.
        port: TCP port of the MRS link; 0 for a free one, which the executive prints.
        shared: whether the domain has other participants.
    """

    domain: int
    port: int
    shared: bool

    def next_address(self, number: int) -> "RoverAddress":
        """Return the address of a further rover in the same domain, at the port plus a number."""
        return self if self.port == ANY_PORT else replace(self, port=self.port + number)


def default_address() -> RoverAddress:
    """Return the default address of `rover command`, `rover status` and `rover watch`.

    Raises:
        AddressError: the port is in use, or ROVER_URI or ROS_DOMAIN_ID exclude it.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdecimal() and int(domain) <= LAST_DOMAIN):
        raise AddressError(f"ROS_DOMAIN_ID is {domain!r}: a domain is 0 to {LAST_DOMAIN}")
    port = _known_port()
    if not is_free(port):
        raise AddressError(
            f"port {port} of {HOST} is in use, probably by another rover. End that one, or start"
            " a second one beside it by --port 22000."
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
            f"ROVER_URI is {address}: `rover command` connects there, and a simulated rover"
            f" stays on {HOST}. Unset ROVER_URI, or run without --stay."
        )
    return uri.port


@contextmanager
def allocate_address(port: int = ANY_PORT) -> Iterator[RoverAddress]:
    """Reserve an unused ROS domain; with a port, or any.

    Raises:
        AddressError: all domains are in use, or the port is.
    """
    if port != ANY_PORT and not is_free(port):
        raise AddressError(f"port {port} of {HOST} is in use: choose another one")
    with ExitStack() as held:
        for domain in DOMAINS:
            reservation = held.enter_context(socket.socket())
            try:
                reservation.bind((HOST, RESERVATION_PORT + domain))
            except OSError:
                continue
            if _is_empty(domain):
                yield RoverAddress(domain, port, shared=False)
                return
    raise AddressError("every ROS domain from 1 to 101 is in use on this machine")


def is_free(port: int) -> bool:
    """Return whether a TCP port of this computer is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def free_tcp_port() -> int:
    """Return a free TCP port, for a process with a port that another one must know."""
    with socket.socket() as probe:
        probe.bind((HOST, ANY_PORT))
        return int(probe.getsockname()[1])


def free_udp_ports(count: int) -> list[int]:
    """Return free UDP ports, for processes that must know each other's ports in advance."""
    with ExitStack() as held:
        probes = [held.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(count)]
        for probe in probes:
            probe.bind((HOST, ANY_PORT))
        return [int(probe.getsockname()[1]) for probe in probes]


def _is_empty(domain: int) -> bool:
    """Return whether a ROS domain has no participant on this machine."""
    with socket.socket(type=socket.SOCK_DGRAM) as discovery:
        try:
            discovery.bind(("", DISCOVERY_PORT + DISCOVERY_PORTS * domain))
        except OSError:
            return False
    return True
