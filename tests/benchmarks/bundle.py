"""What embedded bundle agents reach: durable throughput, recovery, memory, restart.

Sender and receiver are processes of their own, joined by LTP over UDP on loopback; every bundle is
on the disk at both ends before it counts.
"""

import json
import os
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Final

from tests.support.figures import Figure, Goal
from tests.support.ports import free_udp_ports
from tests.support.victims import CHECKOUT, Victim, Workplace, workplace

PEER: Final = "tests.benchmarks.bundle_peer"
_LIMIT_S: Final = 120.0
_DARK: Final = 300
_QUEUE: Final = 100_000


def measure(count: int, octets: int = 100) -> list[Figure]:
    """Return the figures of embedded agents, with bundles of this many octets."""
    figures = []
    for part in (_throughput, _recovery, _queue):
        with workplace() as workspace:
            figures += part(workspace, count, octets)
    return figures


def _values(peer: Victim, what: str) -> dict[str, Any]:
    """Wait until a peer says something; return what it adds to it."""
    line = peer.wait(f'(?m)^{{"what": "{what}".*}}$', _LIMIT_S)[0]
    return dict(json.loads(line))


def _pair(workspace: Workplace, count: int, octets: int, *more: str) -> tuple[Victim, Victim]:
    one, two = free_udp_ports(2)
    far = workspace.start(
        "receiver", PEER, "receive", workspace.folder / "in.db",
        "--listen", two, "--peer", one, "--count", count,
    )  # fmt: skip
    _values(far, "listens")
    near = workspace.start(
        "sender", PEER, "send", workspace.folder / "out.db", "--listen", one, "--peer", two,
        "--count", count, "--octets", octets, *more,
    )  # fmt: skip
    return far, near


def _throughput(workspace: Workplace, count: int, octets: int) -> list[Figure]:
    far, near = _pair(workspace, count, octets)
    began_s = _values(near, "begins")["time_s"]
    put, arrived = _values(near, "all are on the disk"), _values(far, "all came")
    handed_on = _values(near, "all are handed on")
    if arrived["different"] != count:
        raise RuntimeError(f"{arrived['different']} different bundles came, not {count}")
    beside = f"{count} of {octets} octets, one commit before each answer, both ends"
    commits = _commits_per_s(workspace.folder)
    rate = count / (arrived["time_s"] - began_s)
    return [
        Figure("bundles, durable, end to end", rate, "1/s", beside, Goal(3000.0, at_least=True)),
        Figure("bundles over one commit each", rate / commits, "ratio", "SQLite alone, same disk"),
        Figure("single commits of SQLite", commits, "1/s", "one row each"),
        Figure("send, median, 256 at once", put["median_ms"], "ms", beside),
        Figure("send, p99, 256 at once", put["p99_ms"], "ms", beside),
        Figure("sender, resident memory", handed_on["resident_mb"], "MB", beside),
        Figure("receiver, resident memory", arrived["resident_mb"], "MB", beside),
    ]


def _recovery(workspace: Workplace, _: int, octets: int) -> list[Figure]:
    contact = workspace.folder / "contact"
    far, near = _pair(workspace, _DARK, octets, "--dark-until", str(contact))
    _values(near, "all are on the disk")
    contact.touch()
    up_s = _values(near, "the link is up")["time_s"]
    first_s, all_s = (_values(far, what)["time_s"] for what in ("the first came", "all came"))
    beside = f"{_DARK} queued in the dark"
    return [
        Figure("first bundle after link-up", first_s - up_s, "s", beside, Goal(1.0)),
        Figure("all bundles after link-up", all_s - up_s, "s", beside, Goal(5.0)),
    ]


def _queue(workspace: Workplace, _: int, octets: int) -> list[Figure]:
    store = workspace.folder / "queue.db"
    filled = ("fill", store, "--count", _QUEUE, "--octets", octets)
    subprocess.run(
        [sys.executable, "-m", PEER, *map(str, filled)], check=True, cwd=CHECKOUT, timeout=_LIMIT_S
    )
    started = _values(workspace.start("queue", PEER, "start", store), "started")
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
