"""What embedded bundle agents reach: durable throughput, recovery, memory, restart.

Sender and receiver are processes of their own, joined by LTP over UDP on loopback; every bundle is
on the disk at both ends before it counts.
"""

import json
import os
import socket
import sqlite3
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from tests.support.figures import Figure, Goal

_LIMIT_S: Final = 120.0
_DARK: Final = 300
_QUEUE: Final = 100_000


class _Peer:
    """A process of `bundle_peer.py` and what it says."""

    def __init__(self, *arguments: object) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.bundle_peer", *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def said(self, what: str) -> dict[str, Any]:
        """Return what it says next; it has to be this."""
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        said = json.loads(line) if line else {"what": "nothing"}
        if said["what"] != what:
            raise RuntimeError(f"the bundle agent said {said['what']!r}, not {what!r}")
        return dict(said)

    def tell(self) -> None:
        """Let it go on."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()

    def __enter__(self) -> "_Peer":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate(timeout=_LIMIT_S) if sys.exc_info()[0] is None else None
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()


def measure(count: int = 20_000, octets: int = 100) -> list[Figure]:
    """Return the figures of embedded agents, with bundles of this many octets."""
    with tempfile.TemporaryDirectory() as folder:
        return [
            *_throughput(Path(folder), count, octets),
            *_recovery(Path(folder), octets),
            *_queue(Path(folder), octets),
        ]


def _throughput(folder: Path, count: int, octets: int) -> list[Figure]:
    one, two = _free_ports()
    with (
        _Peer("receive", folder / "in.db", "--listen", two, "--peer", one, "--count", count) as far,
        _Peer(
            "send", folder / "out.db", "--listen", one, "--peer", two,
            "--count", count, "--octets", octets,
        ) as near,
    ):  # fmt: skip
        far.said("listens")
        began_s = near.said("begins")["time_s"]
        put = near.said("all are on the disk")
        far.said("the first came")
        came = far.said("all came")
        handed_on = near.said("all are handed on")
    if came["different"] != count:
        raise RuntimeError(f"{came['different']} different bundles came, not {count}")
    beside = f"{count} of {octets} octets, one commit before each answer, both ends"
    commits = _commits_per_s(folder)
    rate = count / (came["time_s"] - began_s)
    return [
        Figure("bundles, durable, end to end", rate, "1/s", beside, Goal(3000.0, at_least=True)),
        Figure("bundles over one commit each", rate / commits, "ratio", "SQLite alone, same disk"),
        Figure("single commits of SQLite", commits, "1/s", "one row each"),
        Figure("send, median, 256 at once", put["median_ms"], "ms", beside),
        Figure("send, p99, 256 at once", put["p99_ms"], "ms", beside),
        Figure("sender, resident memory", handed_on["resident_mb"], "MB", beside),
        Figure("receiver, resident memory", came["resident_mb"], "MB", beside),
    ]


def _recovery(folder: Path, octets: int) -> list[Figure]:
    one, two = _free_ports()
    with (
        _Peer("receive", folder / "i.db", "--listen", two, "--peer", one, "--count", _DARK) as far,
        _Peer(
            "send", folder / "o.db", "--listen", one, "--peer", two,
            "--count", _DARK, "--octets", octets, "--dark",
        ) as near,
    ):  # fmt: skip
        far.said("listens")
        near.said("begins")
        near.said("all are on the disk")
        near.tell()
        up_s = near.said("the link is up")["time_s"]
        first_s = far.said("the first came")["time_s"]
        all_s = far.said("all came")["time_s"]
        near.said("all are handed on")
    beside = f"{_DARK} queued in the dark"
    return [
        Figure("first bundle after link-up", first_s - up_s, "s", beside, Goal(1.0)),
        Figure("all bundles after link-up", all_s - up_s, "s", beside, Goal(5.0)),
    ]


def _queue(folder: Path, octets: int) -> list[Figure]:
    store = folder / "queue.db"
    with _Peer("fill", store, "--count", _QUEUE, "--octets", octets):
        pass
    with _Peer("start", store) as peer:
        started = peer.said("started")
    if started["queued"] != _QUEUE:
        raise RuntimeError(f"{started['queued']} bundles are queued, not {_QUEUE}")
    beside = f"{_QUEUE} queued"
    return [
        Figure("restart", started["took_s"], "s", beside, Goal(2.0)),
        Figure("resident memory, queued", started["resident_mb"], "MB", beside, Goal(30.0)),
    ]


def _commits_per_s(folder: Path) -> float:
    """Return how many durable commits SQLite makes here, one row in each."""
    db = sqlite3.connect(folder / "commits.db", isolation_level=None)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = FULL")
    db.execute("CREATE TABLE rows (octets BLOB)")
    began_s, count = time.perf_counter(), 0
    while time.perf_counter() - began_s < 1.0:
        db.execute("INSERT INTO rows VALUES (?)", (os.urandom(100),))
        count += 1
    took_s = time.perf_counter() - began_s
    db.close()
    return count / took_s


def _free_ports() -> tuple[int, int]:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as two,
    ):
        one.bind(("127.0.0.1", 0))
        two.bind(("127.0.0.1", 0))
        return one.getsockname()[1], two.getsockname()[1]
