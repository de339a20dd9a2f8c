"""Ports that nobody has, for processes that must know each other's before they start."""

import socket
from collections.abc import Iterator
from itertools import cycle

BLOCKS = [range(first, first + 180) for first in range(2000, 7400, 180)]
"""Below the ports of ROS domains, and below those that connections take."""
HOST = "127.0.0.1"


def _reserved_ports() -> Iterator[int]:
    """Go round the ports of a block that no other test process takes while this one lives."""
    for block in BLOCKS:
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as reservation:
            try:
                reservation.bind((HOST, block[0]))
            except OSError:
                continue
            yield from cycle(block[1:])
    raise RuntimeError("all blocks of ports are in use")


_PORTS = _reserved_ports()


def _free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(socket.AF_INET, kind) as probe:
        if kind is socket.SOCK_STREAM:  # as servers do: closed connections do not hinder them
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    return next(port for port in _PORTS if _free(port, kind))


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> list[int]:
    return [free_port(kind) for _ in range(count)]


def free_udp_ports(count: int) -> list[int]:
    return free_ports(count, socket.SOCK_DGRAM)
