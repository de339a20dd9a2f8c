"""`python -m tests.stress.lossy_link`: a link between two LTP engines that does all that links do.

It loses, doubles and delays datagrams, so that they overtake each other, and goes dark. Dark times
are 1 to 60 s, all times divided by `--scale`. In the end it says what it has done.
"""

import argparse
import heapq
import select
import signal
import socket
import time
from collections import Counter
from itertools import count
from random import Random
from typing import Final

LISTENS: Final = "the link is there"
DONE: Final = "done to datagrams: "
COUNTS: Final = {
    "carried": "datagrams carried",
    "lost": "datagrams lost",
    "doubled": "datagrams doubled",
    "late": "datagrams delayed",
    "dark": "datagrams sent while there was no contact",
    "nights": "times without contact",
}
"""What is counted, and what it is called for people."""
DOUBLED: Final = 0.03
SLOW: Final = 0.1
"""Part of the datagrams that take up to `MOST_DELAY_S`."""
MAX_DELAY_S: Final = 1.0
LIT_S: Final = 60.0
"""Between two dark times, on average."""
DARK_S: Final = (1.0, 60.0)
_HOST: Final = "127.0.0.1"
_BUFFER_OCTETS: Final = 4 << 20
_MAX_OCTETS: Final = 65_536


class LossyLink:
    """Decides what becomes of each datagram.

    Args:
        loss: part that is lost.
        scale: by what all times are divided.
    """

    def __init__(self, random: Random, loss: float, scale: float) -> None:
        self.done = Counter(dict.fromkeys(COUNTS, 0))
        self._random, self._loss, self._scale = random, loss, scale
        self._dusk_s = random.expovariate(1 / LIT_S) / scale
        self._dawn_s = self._dusk_s + random.uniform(*DARK_S) / scale

    def delays_s(self, now_s: float) -> list[float]:
        """Return after how long a datagram arrives, for each of its copies."""
        if self._is_dark(now_s):
            self.done["dark"] += 1
            return []
        copies = 2 if self._random.random() < DOUBLED else 1
        self.done["doubled"] += copies - 1
        return [self._delay_s() for _ in range(copies) if not self._is_lost()]

    def _is_dark(self, now_s: float) -> bool:
        while now_s >= self._dawn_s:
            self.done["nights"] += 1
            self._dusk_s = self._dawn_s + self._random.expovariate(1 / LIT_S) / self._scale
            self._dawn_s = self._dusk_s + self._random.uniform(*DARK_S) / self._scale
        return now_s >= self._dusk_s

    def _is_lost(self) -> bool:
        lost = self._random.random() < self._loss
        self.done["lost"] += lost
        return lost

    def _delay_s(self) -> float:
        self.done["carried"] += 1
        if self._random.random() >= SLOW:
            return 0.0
        self.done["late"] += 1
        return self._random.uniform(0.0, MAX_DELAY_S) / self._scale


def carry(ends: list[tuple[int, int]], link: LossyLink) -> None:
    """Carry datagrams for ever: from the port where one end sends to, to that of the other."""
    sockets = {}
    for listen, target in ends:
        end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_OCTETS)
        end.bind((_HOST, listen))
        sockets[end] = (_HOST, target)
    print(LISTENS, flush=True)
    began_s, order = time.monotonic(), count()
    waiting: list[tuple[float, int, socket.socket, bytes]] = []
    while True:
        now_s = time.monotonic() - began_s
        while waiting and waiting[0][0] <= now_s:
            _, _, end, datagram = heapq.heappop(waiting)
            end.sendto(datagram, sockets[end])
        patience_s = waiting[0][0] - now_s if waiting else None
        for end in select.select(list(sockets), [], [], patience_s)[0]:
            try:
                datagram = end.recv(_MAX_OCTETS)
            except ConnectionRefusedError:
                continue  # who is killed does not listen
            now_s = time.monotonic() - began_s
            for delay_s in link.delays_s(now_s):
                heapq.heappush(waiting, (now_s + delay_s, next(order), end, datagram))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--end", type=int, nargs=2, action="append", metavar=("LISTEN", "TARGET"))
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    reported = parser.parse_args()
    link = LossyLink(Random(reported.seed), reported.loss, reported.scale)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        carry(reported.end, link)
    except KeyboardInterrupt:
        print(DONE + " ".join(f"{kind}={number}" for kind, number in link.done.items()))


if __name__ == "__main__":
    main()
