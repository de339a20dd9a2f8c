"""UDP ports that nobody has, for agents that must know each other's before they start."""

import socket
from contextlib import ExitStack


def free_udp_ports(count: int) -> list[int]:
    with ExitStack() as held:
        sockets = [
            held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            for _ in range(count)
        ]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [int(one.getsockname()[1]) for one in sockets]
