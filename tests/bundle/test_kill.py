"""kill -9 of real processes on real sockets: what `send` returned for arrives, and once."""

import random
import socket
import subprocess
import sys
import time
from pathlib import Path

from tests.bundle.victim import lines

CHECKOUT = Path(__file__).resolve().parents[2]
KILLS = 12
LIMIT_S = 60.0


class Victim:
    def __init__(self, role: str, folder: Path, port: int, peer: int) -> None:
        self.command = [
            sys.executable, "-m", "tests.bundle.victim", role, str(folder), str(port), str(peer),
        ]  # fmt: skip
        self.start()

    def start(self) -> None:
        self.process = subprocess.Popen(self.command, cwd=CHECKOUT)

    def kill(self) -> None:
        assert self.process.poll() is None, "it ended by itself"
        self.process.kill()
        self.process.wait()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def wait_for_growth(path: Path, before: int) -> None:
    """Wait until a record has grown: the process runs and works."""
    deadline_s = time.monotonic() + LIMIT_S
    while not path.exists() or path.stat().st_size <= before:
        assert time.monotonic() < deadline_s, f"{path.name} does not go on"
        time.sleep(0.01)


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def test_no_kill_loses_or_doubles_anything(tmp_path: Path) -> None:
    chance = random.Random(1)
    one, two = free_port(), free_port()
    sent, received = tmp_path / "send", tmp_path / "receive"
    victims = [Victim("send", tmp_path, one, two), Victim("receive", tmp_path, two, one)]
    try:
        for _ in range(KILLS):
            for path in (sent, received):
                wait_for_growth(path, size_of(path))
            time.sleep(chance.uniform(0.0, 0.1))
            victim = chance.choice(victims)
            victim.kill()
            victim.start()
        wait_for_growth(sent, size_of(sent))
        victims[0].kill()
        numbers = {line.strip() for line in lines(sent)}
        last_s = time.monotonic() + LIMIT_S
        # The sender's store still holds what was not handed on: it goes on from there.
        victims[0].start()
        while not numbers <= {line.split()[-1] for line in lines(received)}:
            assert time.monotonic() < last_s, "something does not arrive"
            time.sleep(0.05)
    finally:
        for victim in victims:
            victim.process.kill()
            victim.process.wait()
    had = [line.rsplit(" ", 1)[0] for line in lines(received)]
    assert len(had) == len(set(had))
    assert len(numbers) > KILLS
