"""Records the traces: `python -m tests.support.behaviortree_cpp.record DRIVER`; see README.md."""

import json
import lzma
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import count, islice
from typing import Any, Final

from tests.support.behaviortree_cpp.differences import DIFFERENCES_OF_4_10
from tests.support.behaviortree_cpp.traces import (
    DIFFERENCES,
    DIGESTS,
    FOLDER,
    FULL,
    NOT_RECORDED,
    SCRIPTS,
    RecordedPlan,
    Trace,
    TracedTick,
    digest_of,
)
from tests.support.random_plans import STEP_MS, TELEMETRY, TICKS, RandomPlan, random_plan
from tests.support.random_scripts import RESULT, random_script, script_plan

CORRECTIONS: Final = ("IfThenElse", "WhileDoElse", "Precondition", "Timeout", "SetBlackboard")
SCRIPT_COUNT: Final = 1_000
FULL_COUNT: Final = 1_000
DIGEST_COUNT: Final = 30_000
PORTION: Final = 1_000
"""Trees that one process of the driver executes: it never frees one."""
INFINITE: Final = ("inf", "-inf")
UNDEFINED: Final = "nan"
ONE_TICK: Final = 4
"""Of plans that end in their first tick one in this many is recorded."""


def request(plan: RandomPlan, corrections: Sequence[str]) -> dict[str, object]:
    """Return the driver's input for a plan."""
    return {
        "xml": plan.text,
        "ticks": TICKS,
        "step_ms": STEP_MS,
        "abort": plan.abort,
        "telemetry": plan.telemetry,
        "corrections": corrections,
    }


def execute(driver: str, requests: Sequence[Mapping[str, object]]) -> list[dict[str, Any]]:
    """Return what the driver writes for these inputs."""
    lines = "".join(json.dumps(each) + "\n" for each in requests)
    ended = subprocess.run(
        [driver], input=lines, capture_output=True, text=True, check=True, encoding="utf-8"
    )
    answers = [json.loads(line) for line in ended.stdout.splitlines()]
    assert len(answers) == len(requests), ended.stderr
    return answers


def trace_from(answer: Mapping[str, Any]) -> Trace:
    """Return the trace that the driver wrote, without telemetry; its numbers become floats."""

    def plain(value: Any) -> Any:
        return float(value) if isinstance(value, int) or value in INFINITE else value

    return tuple(
        TracedTick(
            tick["result"],
            tick["status"],
            tuple(
                sorted(
                    (tree, name, plain(value))
                    for tree, name, value in tick["cells"]
                    if name not in TELEMETRY
                )
            ),
            tuple((what, number, *map(plain, ports)) for what, number, *ports in tick["leaves"]),
        )
        for tick in answer["ticks"]
    )


def record(driver: str) -> Iterator[RecordedPlan]:
    """Yield the recorded plans in the order of their seeds, for ever.

    A plan that 4.10 with its corrections ends by an exception is not recorded: a wrong number of
    children, a type that cannot be assigned. Neither is one with a number that is none.
    """
    for first in count(step=PORTION):
        seeds = range(first, first + PORTION)
        plans = [random_plan(seed) for seed in seeds]
        corrected = execute(driver, [request(plan, CORRECTIONS) for plan in plans])
        pure = execute(driver, [request(plan, ()) for plan in plans])
        for seed, plan, answer, original in zip(seeds, plans, corrected, pure, strict=True):
            short = len(answer["ticks"]) < 2 and seed % ONE_TICK
            if answer["error"] or short or UNDEFINED in json.dumps(answer):
                continue
            needed = () if original == answer else _needed(driver, plan, answer)
            yield RecordedPlan(seed, trace_from(answer), needed, answer["bounded"])


def _needed(driver: str, plan: RandomPlan, wanted: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the fewest corrections with which a plan has its trace."""
    subsets = [
        tuple(each for at, each in enumerate(CORRECTIONS) if bits >> at & 1)
        for bits in range(1, 1 << len(CORRECTIONS))
    ]
    answers = execute(driver, [request(plan, subset) for subset in subsets])
    fitting = [s for s, answer in zip(subsets, answers, strict=True) if answer == wanted]
    return min(fitting, key=len)


def main(driver: str) -> None:
    """Write the data."""
    FOLDER.mkdir(exist_ok=True)
    _write_differences(driver)
    _write_scripts(driver)
    recorded = record(driver)
    full = list(islice(recorded, FULL_COUNT))
    needed = Counter(each.corrections for each in full)
    with lzma.open(FULL, "wt", encoding="utf-8", preset=9 | lzma.PRESET_EXTREME) as lines:
        for each in full:
            ticks = [tick.values() for tick in each.trace]
            row = [each.seed, each.corrections, each.bounded, ticks]
            lines.write(json.dumps(row, separators=(",", ":")) + "\n")
    digests = bytearray()
    for each in islice(recorded, DIGEST_COUNT):
        digests += NOT_RECORDED * (each.seed - len(digests) // len(NOT_RECORDED))
        digests += digest_of(each.trace)
        needed[each.corrections] += 1
    DIGESTS.write_bytes(lzma.compress(bytes(digests), preset=9 | lzma.PRESET_EXTREME))
    for corrections, number in needed.most_common():
        print(number, *corrections or ("as 4.10",))


def _write_differences(driver: str) -> None:
    found = {}
    for name, difference in DIFFERENCES_OF_4_10.items():
        original = request(difference.plan, ()) | {"halt_tree": True}
        pure, corrected = execute(driver, [original, request(difference.plan, CORRECTIONS)])
        found[name] = {
            "error": pure["error"],
            "bounded": pure["bounded"],
            "4.10": [tick.values() for tick in trace_from(pure)],
            "corrected": [tick.values() for tick in trace_from(corrected)],
        }
    DIFFERENCES.write_text(json.dumps(found, indent=1) + "\n", "utf-8")


def _write_scripts(driver: str) -> None:
    plans = [script_plan(random_script(seed)) for seed in range(SCRIPT_COUNT)]
    found = []
    for answer in execute(driver, [request(plan, ()) for plan in plans]):
        ticks = [] if answer["error"] else trace_from(answer)
        values = [value for tick in ticks for _, name, value in tick.cells if name == RESULT]
        found.append(values[0] if values else None)
    SCRIPTS.write_bytes(lzma.compress(json.dumps(found).encode(), preset=9 | lzma.PRESET_EXTREME))


if __name__ == "__main__":
    main(sys.argv[1])
