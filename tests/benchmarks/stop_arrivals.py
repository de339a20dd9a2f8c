"""`python -m tests.benchmarks.stop_arrivals PORTS...`: a wire, and when a stop came along it.

It joins an orbiter to a rover by UDP, and prints the time of each datagram for the rover that holds
a stop by `time.perf_counter`, which all processes of a computer share.
"""

import select
import socket
import sys
import time
from typing import Final

JOINS: Final = "joins"
HERE: Final = "127.0.0.1"
_STOP: Final = b"|STOP|"
_MAX_OCTETS: Final = 65_535


def main(orbiter: int, to_orbiter: int, to_rover: int, rover: int) -> None:
    """Join for ever.

    Args:
        orbiter: the port of the orbiter.
        to_orbiter: the port that the orbiter takes for the rover.
        to_rover: the port that the rover takes for the orbiter.
        rover: the port of the rover.
    """
    up, down = (socket.socket(type=socket.SOCK_DGRAM) for _ in range(2))
    up.bind((HERE, to_orbiter))
    down.bind((HERE, to_rover))
    print(JOINS, flush=True)
    while True:
        ready, _, _ = select.select((up, down), (), ())
        if up in ready:
            datagram = up.recv(_MAX_OCTETS)
            if _STOP in datagram:
                print(time.perf_counter(), flush=True)
            down.sendto(datagram, (HERE, rover))
        if down in ready:
            up.sendto(down.recv(_MAX_OCTETS), (HERE, orbiter))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
