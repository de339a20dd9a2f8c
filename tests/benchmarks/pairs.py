"""Runs this tree and an earlier commit in turn, and names what takes longer now.

The earlier commit is the last one of the history file that this machine measured. A figure is the
median of the ratios of pairs, each of two processes that ran one after the other; its noise is the
interval of that median at 98 % confidence, from the order of the ratios (Conover, Practical
Nonparametric Statistics, 1999, section 3.2), which assumes no distribution.
"""

import json
import os
import platform
import subprocess
import sys
import tarfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from io import BytesIO
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Final

from tests.support.figures import Figure, Goal

CHECKOUT: Final = Path(__file__).resolve().parents[2]
HISTORY: Final = CHECKOUT / "runs" / "bench-history.jsonl"
PROBES: Final = Path(__file__).with_name("probes.py")
CONFIDENCE: Final = 0.98
PEERS: Final = {
    "tick of 40 nodes, µs": "tick in BehaviorTree.CPP, µs",
    "lock step at rest, ms": "mj_step alone, ms",
}
"""The comparison of a figure, from the same run."""


@dataclass(frozen=True, slots=True)
class Measured:
    """A line of the history: medians of one commit on one machine."""

    utc: str
    machine: str
    commit: str
    figures: dict[str, float]


def machine() -> str:
    """Return what times depend on: processor, how many, and the Python."""
    models = [
        line.split(":")[1].strip()
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        if line.startswith("model name")
    ]
    python = platform.python_version()
    return f"{platform.node()}, {len(models)} x {models[0] if models else '?'}, Python {python}"


def last_commit(history: Path, on: str, other_than: str) -> str | None:
    """Return the commit that a machine measured last, other than this one; None for none."""
    lines = history.read_text(encoding="utf-8").splitlines() if history.is_file() else []
    rows = [Measured(**json.loads(line)) for line in lines]
    found = [row.commit for row in rows if row.machine == on and row.commit != other_than]
    return found[-1] if found else None


def median_interval(values: Sequence[float]) -> tuple[float, float]:
    """Return the confidence interval of the median of the distribution behind the values.

    With fewer than seven values it is their range, at less confidence.
    """
    from scipy.stats import binom  # slow to import

    ordered = sorted(values)
    cut = max(int(binom.ppf((1.0 - CONFIDENCE) / 2.0, len(ordered), 0.5)) - 1, 0)
    return ordered[cut], ordered[-1 - cut]


def measure(
    against: str | None, rounds: int, log: Callable[[str], None], history: Path = HISTORY
) -> list[Figure]:
    """Measure both trees, append to the history, and return the ratios and the peers.

    Args:
        against: a commit; None for the last of the history, or the parent of this one.
        rounds: how many pairs.

    Raises:
        ChildProcessError: git does not know the commit, or this tree's workloads fail.
    """
    here = _git("rev-parse", "HEAD").decode().strip()
    wanted = against or last_commit(history, machine(), here) or "HEAD^"
    commit = _git("rev-parse", "--verify", f"{wanted}^{{commit}}").decode().strip()
    log(f"pairs: this tree and {commit[:8]} in turn, {rounds} times, about {rounds} minutes ...")
    pairs: list[tuple[dict[str, float], dict[str, float]]] = []
    with TemporaryDirectory(prefix="rover-bench-") as folder:
        earlier = Path(folder)
        with tarfile.open(fileobj=BytesIO(_git("archive", commit))) as tree:
            tree.extractall(earlier, filter="data")
        for number in range(rounds):
            # Each is the first as often as the second: the machine may become slower.
            first, second = (earlier, CHECKOUT) if number % 2 else (CHECKOUT, earlier)
            found = {tree: _probe(tree) for tree in (first, second)}
            pairs.append((found[earlier], found[CHECKOUT]))
    names = [name for name in pairs[0][1] if all(name in after for _, after in pairs)]
    medians = {name: median(after[name] for _, after in pairs) for name in names}
    append(history, Measured(_utc(), machine(), here, medians))
    return [figure for name in names for figure in _figures(name, medians, pairs, commit)]


def _figures(
    name: str,
    medians: dict[str, float],
    pairs: Sequence[tuple[dict[str, float], dict[str, float]]],
    commit: str,
) -> list[Figure]:
    what, unit = name.rsplit(", ", 1)
    peer = medians.get(PEERS.get(name, ""))
    beside = f"{PEERS[name]}: {peer:.3g}" if peer else ""
    found = [Figure(what, medians[name], unit, beside)]
    if name not in PEERS.values() and all(name in before for before, _ in pairs):
        ratios = [after[name] / before[name] for before, after in pairs]
        low, high = median_interval(ratios)
        text = f"{commit[:8]}, {len(ratios)} pairs: {low:.3f} to {high:.3f}"
        slower = Goal(1.0) if low > 1.0 else None
        found.append(Figure(f"{what}: now over before", median(ratios), "ratio", text, slower))
    return found


def _probe(tree: Path) -> dict[str, float]:
    environment = os.environ | {"PYTHONPATH": str(tree)}
    done = subprocess.run(
        [sys.executable, "-P", str(PROBES)],
        cwd=tree,
        env=environment,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        raise ChildProcessError(f"{tree}: {done.stderr.decode(errors='replace')[-500:]}")
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


def _git(*arguments: str) -> bytes:
    done = subprocess.run(["git", *arguments], cwd=CHECKOUT, capture_output=True, check=False)
    if done.returncode:
        raise ChildProcessError(f"git {' '.join(arguments)}: {done.stderr.decode().strip()}")
    return done.stdout


def _utc() -> str:
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def append(history: Path, measured: Measured) -> None:
    """Append a line to the history."""
    history.parent.mkdir(parents=True, exist_ok=True)
    with history.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(measured), ensure_ascii=False) + "\n")
