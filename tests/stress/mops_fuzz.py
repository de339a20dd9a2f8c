"""Wrong MOPS strings against everything that reads them: does anything give way?"""

import tempfile
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path
from typing import Final

from adapters.mops import load_dictionary
from executive.settings import Settings
from tests.stress.findings import Log
from tests.stress.fuzzing import attack, break_nothing
from tests.stress.mops_aboard import Aboard
from tests.stress.mops_readers import BRICK, Brick, Fault, MopsFindings, Orbiter, Parsers, Reader
from tests.stress.mops_strings import Wrong
from tests.support.figures import Figure, Goal

MAX_GROWTH_MB: Final = 5.0


def measure(
    settings: Settings,
    count: int,
    seed: int,
    log: Log,
    prepare: Callable[[], None] = break_nothing,
) -> list[Figure]:
    """Return how often a promise was broken.

    Args:
        settings: of the rover.
        count: texts, of one to three messages each and a sound one behind them.
        seed: of everything random.
        log: called with a line on each of the first faults.
        prepare: called when everybody is there; tests break them.
    """
    dictionary, findings, asset = load_dictionary(), MopsFindings(log), settings.asset.upper()
    with tempfile.TemporaryDirectory(prefix="rover-mops-") as workspace, ExitStack() as stack:
        ours, theirs = Wrong(asset, seed), Wrong(BRICK, seed)
        readers: list[tuple[Wrong, Reader]] = [
            (ours, Parsers(dictionary)),
            (ours, Aboard(dictionary, settings, Path(workspace) / "aboard")),
            (ours, Orbiter(dictionary, Path(workspace) / "orbiter", asset)),
            (theirs, Brick(dictionary)),
        ]
        for _, reader in readers:
            stack.enter_context(closing(reader))
        prepare()
        takers = [
            (wrong.portions, partial(reader.take, findings=findings)) for wrong, reader in readers
        ]
        duration_s, grown_mb = attack(takers, count, findings, Fault.RAISED)
    mutated = ours.mutated + theirs.mutated
    beside = f"{mutated} mutated messages, seed {seed}"
    return [
        Figure("MOPS: mutated messages", mutated, "messages", beside),
        Figure("MOPS: texts", count, "texts", "the last message of each is sound"),
        Figure("MOPS: rate", mutated / duration_s, "1/s", "making and judging too"),
        *findings.figures("MOPS", Fault, beside),
        Figure("MOPS: memory gained", grown_mb, "MB", "since 30% of it", Goal(MAX_GROWTH_MB)),
    ]
