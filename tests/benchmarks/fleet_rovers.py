"""Rovers of the benchmark `console-fleet`: `python -m tests.benchmarks.fleet_rovers`.

Each has its executive and its service layer on a socket of its own; they share a process, move as
told, without physics, and their time runs as fast as ours.
"""

import sys
import time
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Final

from executive.commands import MoveForward, SetStatusInterval
from executive.values.parameters import Parameter
from tests.mrs.aboard import Aboard, LinkedBench

STEP_S: Final = 0.1
DRIVE_EACH_S: Final = 20.0
"""Each rover is commanded so often, forward and back."""
STEPS: Final = round(DRIVE_EACH_S / STEP_S)
DISTANCE_M: Final = 2.0


def main(folder: str, first: str, count: str, values_hz: str, at: str = "") -> None:
    """Run rovers until the process is ended.

    Args:
        folder: for their data.
        first: the number of the first.
        count: how many.
        values_hz: how many telemetry values each tells a second.
        at: the service layer where they register; that of the first, unless it is given.
    """
    numbers = range(int(first), int(first) + int(count))
    with ExitStack() as running:
        rovers: list[Aboard] = []
        for number in numbers:
            name = f"rover{number:02}"
            layer = at or (rovers[0].uri if rovers else None)
            rover = Aboard(Path(folder) / name, asset=name, service_layer=layer)
            rovers.append(running.enter_context(closing(rover)))
            log = SetStatusInterval(len(Parameter) / float(values_hz))
            rover.do(partial(LinkedBench.submit, request=log, number=1))
        print(rovers[0].uri, flush=True)
        began_s, step = time.monotonic(), 0
        while True:
            for number, rover in zip(numbers, rovers, strict=True):
                drives = (step + 10 * number) % STEPS == 0
                rover.do(partial(_live, step=step if drives else None))
            step += 1
            time.sleep(max(began_s + step * STEP_S - time.monotonic(), 0.0))


def _live(bench: LinkedBench, step: int | None) -> None:
    if step is not None:
        is_back = step // STEPS % 2
        bench.submit(MoveForward(-DISTANCE_M if is_back else DISTANCE_M), step + 2)
    bench.run(STEP_S)


if __name__ == "__main__":
    main(*sys.argv[1:])
