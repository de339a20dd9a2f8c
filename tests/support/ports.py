"""Ports that nobody has, for processes that must know each other's before they start."""

import socket
from contextlib import ExitStack
from random import SystemRandom

PORTS = range(2000, 7400)  # below those of ROS domains, and of those that connections take
_CHANCE = SystemRandom()


def free_ports(count: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> list[int]:
    with ExitStack() as held:
        ports: list[int] = []
        while len(ports) < count:
            port = _CHANCE.choice(PORTS)
            probe = held.enter_context(socket.socket(socket.AF_INET, kind))
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            ports.append(port)
        return ports


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    return free_ports(1, kind)[0]


def free_udp_ports(count: int) -> list[int]:
    return free_ports(count, socket.SOCK_DGRAM)
