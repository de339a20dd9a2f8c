"""Where a demonstration takes place: a ROS domain and a TCP port that nobody else uses."""

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Final

from adapters.mrs.specification import PORT

HOST: Final = "127.0.0.1"
ANY_PORT: Final = 0
DOMAINS: Final = range(101, 0, -1)
"""Higher ids overlap the ports that Linux hands out; most people take the lowest."""
RESERVATION_PORT: Final = 22119
"""As ROS's domain_coordinator does it, so that tests and demonstrations keep apart."""


class PlaceError(Exception):
    """Another rover is there; the text says where and what to do."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where the processes meet.

    Attributes:
        port: TCP port of the MRS link; 0 for a free one, which the executive tells.
    """

    domain: int
    port: int


def known_place() -> Place:
    """Return where `rover command`, `rover status` and `rover watch` look without options.

    Raises:
        PlaceError: something listens on the port, or ROS_DOMAIN_ID is no domain.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdecimal() and int(domain) <= 232):
        raise PlaceError(f"ROS_DOMAIN_ID is {domain!r}: a domain is 0 to 232")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, PORT))
        except OSError as error:
            raise PlaceError(
                f"port {PORT} of {HOST} is taken, probably by another rover. End that one, or play"
                " without --stay, which takes a port of its own."
            ) from error
    return Place(int(domain), PORT)


@contextmanager
def free_place() -> Iterator[Place]:
    """Hold a ROS domain that nobody uses, with any port.

    Raises:
        PlaceError: all domains are in use.
    """
    with ExitStack() as held:
        for domain in DOMAINS:
            reservation = held.enter_context(socket.socket())
            discovery = held.enter_context(socket.socket(type=socket.SOCK_DGRAM))
            try:
                reservation.bind((HOST, RESERVATION_PORT + domain))
                discovery.bind(("", 7400 + 250 * domain))
            except OSError:
                continue
            discovery.close()
            yield Place(domain, ANY_PORT)
            return
    raise PlaceError("every ROS domain from 1 to 101 is in use on this machine")
