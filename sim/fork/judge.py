"""`judge`: whether a recorded run would have been better or worse with other settings or code.

`python -m sim.fork.judge` answers `rover replay`: a JSON object from its standard input, a line of
JSON for each recording to its standard output.
"""

import json
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from adapters.recording import RecordingError
from executive.settings import Settings, SettingsError, load_settings
from executive.values.reports import Stage
from sim.fork.forkable import Forkable
from sim.fork.model import Change, Fidelity, ForkRun
from sim.scenario.truth import true_ends

BETTER: Final = "better"
WORSE: Final = "worse"
SAME: Final = "same"
UNKNOWN: Final = "not judged"


def judge(path: Path, settings: Settings | None) -> tuple[str, str]:
    """Judge a recording by its fork: return a verdict and its reason as text.

    Args:
        path: first file of the recording.
        settings: settings that replace those of the recording; None if the code has changed. The
            recording is then compared itself: its code is not available for an unchanged fork.
    """
    try:
        forkable = Forkable(path)
        before, fork = forkable.recorded, forkable.fork(Change(asset=settings))
        if settings is not None:
            before, fidelity = forkable.unchanged(None)
            if fidelity is Fidelity.DIFFERENT:
                return UNKNOWN, "the fork without a change differs from the recording"
    except (RecordingError, SettingsError) as error:
        return UNKNOWN, str(error)
    except Exception as error:  # raised by changed code: the other recordings are still judged
        return UNKNOWN, f"the fork failed: {type(error).__name__}: {error}"
    return compare(before, fork)


def compare(before: ForkRun, after: ForkRun) -> tuple[str, str]:
    """Compare two runs by contacts, then by false EXECUTED, then by the number of true ones.

    A command that was active at the end of the run before has no end to compare with.
    """
    outcomes = before.outcome.commands
    active = {each.command for each in outcomes if not Stage[each.stage].terminal}
    counts = (tuple(_faults(each, active)) for each in (before, after))
    for old, new in zip(*counts, strict=True):
        if old is not None and new is not None and old[0] != new[0]:
            return (WORSE if new[0] > old[0] else BETTER), f"{new[1]}; before: {old[1]}"
    then, now = _unmet(before, active)[1], _unmet(after, active)[1]
    return SAME, "" if then == now else f"{now}; before: {then}"


def _faults(run: ForkRun, active: Collection[str]) -> Iterator[tuple[int, str] | None]:
    """Yield counts with their texts; the fewer, the better. None for an unknown count."""
    contacts = run.outcome.contacts
    yield None if contacts is None else (contacts, f"{contacts} contacts")
    wrong = {each.label: each.wrong for each in true_ends(run.record) if each.wrong}
    yield len(wrong), ", ".join(f"{label} {text}" for label, text in wrong.items()) or "all true"
    yield _unmet(run, active)


def _unmet(run: ForkRun, active: Collection[str]) -> tuple[int, str]:
    """Return the number of commands that did not end EXECUTED, and their ends as text."""
    ended = (each for each in run.outcome.commands if each.command not in active)
    unmet = [each for each in ended if each.stage != Stage.EXECUTED.name]
    texts = (f"{each.command} {each.stage} {each.reason}".rstrip() for each in unmet)
    return len(unmet), ", ".join(texts) or "all EXECUTED"


def main() -> None:
    """Read `recordings`, their paths, and `settings`, an asset, a YAML file or null, from stdin."""
    request = json.load(sys.stdin)
    settings = None if request["settings"] is None else load_settings(request["settings"])
    for path in request["recordings"]:
        print(json.dumps([path, *judge(Path(path), settings)]), flush=True)


if __name__ == "__main__":
    main()
