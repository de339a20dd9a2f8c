"""A recording as what explanations are made from."""

from pathlib import Path

from adapters.recording.run_file import RunReader
from adapters.recording.timed import read_timed
from executive.history import KINDS, HistoryBuilder, RunHistory
from trees import leaf_paths


def read_history(path: Path, until_s: float | None = None) -> tuple[RunHistory, float]:
    """Return what a recording knows, and when it began, seconds since 1970-01-01 UTC.

    Args:
        path: of the recording.
        until_s: leave out what came later, in seconds since its beginning.

    Raises:
        RecordingError: the file cannot be used as a recording, or holds no run.
    """
    builder = HistoryBuilder(leaf_paths)
    began_utc_s: float | None = None
    for each in read_timed(RunReader(path), KINDS):
        if until_s is not None and each.time_s > until_s + 1e-6:
            break
        if began_utc_s is None:
            began_utc_s = each.utc_s - each.time_s
        builder.put(each.item)
    assert began_utc_s is not None
    return builder.history(), began_utc_s
