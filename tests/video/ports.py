"""UDP sockets on loopback, for tests."""

import socket
import time
from collections.abc import Callable
from typing import Final

HOST: Final = "127.0.0.1"
ANSWER_S: Final = 60.0


def udp_socket(port: int = 0, host: str = HOST) -> socket.socket:
    """Return a bound socket that gives up waiting in the end."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    bound.bind((host, port))
    bound.settimeout(ANSWER_S)
    return bound


def free_port() -> int:
    """Return a UDP port that nobody listens on now."""
    with udp_socket() as probe:
        port: int = probe.getsockname()[1]
        return port


def wait_for(done: Callable[[], bool]) -> None:
    """Wait until something holds that another thread brings about."""
    end_s = time.monotonic() + ANSWER_S
    while not done():
        assert time.monotonic() < end_s, "waited in vain"
        time.sleep(0.001)
