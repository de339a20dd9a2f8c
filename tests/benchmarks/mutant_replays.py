"""A process that replays recordings through the core that lies where it is started.

    python -m tests.benchmarks.mutant_replays trace < paths
    python -m tests.benchmarks.mutant_replays check SECONDS < paths

`trace` tells of each recording whether it decides the same, how long that took, which lines of
the core it reached and which of the probed bounds it met; `check` replays up to the first
difference and tells where that is, with at most so much time of the processor.
"""

import builtins
import json
import multiprocessing
import operator
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tests.benchmarks.mutation import PACKAGES, PROBE

if TYPE_CHECKING:
    from adapters.recording.replay import Difference

CHECKOUT: Final = Path(__file__).resolve().parents[2]
MAX_OCTETS: Final = 4 << 30
"""Of memory: a mutant may fill lists for ever."""


@dataclass(frozen=True, slots=True)
class Traced:
    """What a recording reaches; without a path, what the core does when it is imported.

    Attributes:
        difference: where it decides otherwise; empty if it does not.
        took_s: seconds of this process.
        lines: of each file of the core, below the checkout.
        met: places of probes where both sides were equal.
    """

    path: str
    difference: str
    took_s: float
    lines: dict[str, list[int]]
    met: list[str]


def difference_in(path: Path) -> str:
    """Replay a recording, and return in words where it decides otherwise first; empty if not."""
    from adapters.recording import RecordingError
    from adapters.recording.replay import replay

    try:
        found = replay(path).difference
    except RecordingError as error:
        return str(error)
    return "" if found is None else _shown(found)


def _shown(found: "Difference") -> str:
    return f"{found.time_s:.2f} s, {found.entry}: {' | '.join(found.lines)}"


def _trace(path: Path) -> Traced:
    return _traced(str(path), lambda: difference_in(path))


def _imported() -> str:
    import_module("adapters.recording.replay")
    return ""


def _traced(path: str, do: Callable[[], str]) -> Traced:
    from coverage import Coverage

    began_s = time.process_time()
    source = [str(CHECKOUT / package) for package in PACKAGES]
    coverage = Coverage(data_file=None, config_file=False, source=source)
    with coverage.collect():
        difference = do()
    data = coverage.get_data()
    lines = {
        Path(file).relative_to(CHECKOUT).as_posix(): sorted(data.lines(file) or ())
        for file in data.measured_files()
    }
    return Traced(path, difference, time.process_time() - began_s, lines, sorted(_met))


_met: set[str] = set()
"""In this process."""


def _compared(location: str, how: str, left: Any, right: Any) -> Any:
    if left == right:
        _met.add(location)
    return getattr(operator, _OPERATORS.get(how, how))(left, right)


_OPERATORS: Final = {"lte": "le", "gte": "ge"}


def main() -> None:
    """Do what the command line asks for."""
    resource.setrlimit(resource.RLIMIT_AS, (MAX_OCTETS, MAX_OCTETS))
    paths = [Path(line) for line in sys.stdin.read().splitlines()]
    if sys.argv[1] == "check":
        limit_s = int(sys.argv[2])
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s + 1))
        for path in paths:
            if difference := difference_in(path):
                print(f"{path.stem}: {difference}")
                return
        return
    setattr(builtins, PROBE, _compared)
    print(json.dumps(asdict(_traced("", _imported))), flush=True)
    # What a process remembers of one recording must not hide what another reaches.
    with multiprocessing.get_context("fork").Pool(1, maxtasksperchild=1) as pool:
        for traced in pool.imap(_trace, paths):
            print(json.dumps(asdict(traced)), flush=True)


if __name__ == "__main__":
    main()
