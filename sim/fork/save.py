"""`save`: the minimal change that makes a failed run succeed, confirmed with other noise.

Limits are tried at their extreme values first: if these do not save the run, nearer ones do not.
If the fork without a change differs from the recording, a fault is unknown: hypotheses are ranked,
and the run is saved under the best one if that explains it.
"""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import combinations, repeat
from math import ceil, inf
from multiprocessing import get_context
from os import sched_getaffinity
from pathlib import Path
from typing import Any, Final

from executive.commands import Request, declaration_of
from executive.history import CommandHistory
from executive.settings import Settings, SettingsError
from executive.values.reports import Identity, Report, Stage
from sim.fork.candidates import (
    FACTORS,
    Adjustable,
    Candidate,
    arguments_of,
    candidate,
    candidates,
    controllers_for,
    limits_of,
    speeds_of,
)
from sim.fork.forkable import Forkable
from sim.fork.hypotheses import EXPLAINED, Hypothesis, rank, score
from sim.fork.model import Change, Fidelity, ForkRun
from sim.scenario.record import Record
from sim.scenario.truth import check_executed_truth

SHOWN: Final = 5
"""Number of hypotheses that are shown; chosen."""
MAX_TOGETHER: Final = 3
"""Maximum number of limits that are changed together; chosen."""
AT_ONCE: Final = 4
"""Number of candidates that are tried at once; chosen."""
CONFIRMED: Final = 0.75
"""Minimum share of the seeds that a change saves; chosen."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a run with a change is saved.

    Attributes:
        text: why not; empty if it is.
        end: terminal report of the command; None without one.
    """

    text: str
    end: Report | None = None


Play = Callable[[Sequence[Change]], Sequence[Verdict]]
"""Repeats a run with each change."""


def judge(failed: Identity, recorded: Record, played: Record) -> Verdict:
    """Judge a repeated run as scenarios do.

    It is saved if the command ended EXECUTED, every EXECUTED is true, the contacts do not increase,
    and no other command that ended EXECUTED in the recording ends otherwise.
    """
    before, after = recorded.all_lifecycles(), played.all_lifecycles()
    executed = {identity for identity, each in before.items() if _executed(each)}
    lost = [i for i, each in after.items() if i in executed and not _executed(each)]
    end = after[failed].end if failed in after else None
    true = check_executed_truth(played, ())
    if end is None or end.stage is not Stage.EXECUTED:
        return Verdict(f"{failed} {_end_text(end)}", end)
    if lost:
        return Verdict(f"{lost[0]} no longer ends EXECUTED", end)
    if not true.passed:
        return Verdict(f"EXECUTED is not true: {true.observed}", end)
    if (played.contacts or 0) > (recorded.contacts or 0):
        return Verdict(f"{played.contacts} contacts", end)
    return Verdict("", end)


def _executed(command: CommandHistory) -> bool:
    return command.end is not None and command.end.stage is Stage.EXECUTED


def _end_text(end: Report | None) -> str:
    if end is None or end.stage is None:
        return "has no end"
    return f"{end.stage.name} {end.reason.name}" if end.reason else end.stage.name


@dataclass(frozen=True, slots=True)
class Saving:
    """What would have saved a run.

    Attributes:
        minimal: the minimal change that does, as text; empty if none does.
        saved, saved_unchanged: numbers of seeds that succeed with it and without it.
        instead: end of the run with the extreme values of the limits that ended it.
    """

    minimal: str
    saved: int
    saved_unchanged: int
    seeds: int
    instead: str


@dataclass(frozen=True, slots=True)
class Search:
    """A search for the minimal change that saves a run.

    Attributes:
        failed, end, request: the command that failed, its last report, and its request.
        play: repeats the run, also with the seeds that confirm a change.
    """

    failed: Identity
    end: Report
    request: Request
    settings: Settings
    play: Play
    seeds: Sequence[int]

    def run(self) -> Saving:
        """Return the minimal change that saves the run as recorded, and with enough seeds."""
        limits, instead = self._limits()
        sizes = range(1, MAX_TOGETHER + 1)
        groups = [group for size in sizes for group in combinations(limits, size)]
        extreme = [candidate(each, FACTORS[-1]) for each in groups]
        far = self._saving(extreme)
        figures = [group for group, each in zip(groups, extreme, strict=True) if each in far]
        others = *speeds_of(self.settings), *arguments_of(self.failed, self.request)
        every = candidates([*figures, *zip(others)])
        every += controllers_for(self.request, self.settings)
        every.sort(key=lambda each: each.order)
        unchanged = self._confirmed(Change())
        least = max(unchanged, ceil(CONFIRMED * len(self.seeds)))
        for start in range(0, len(every), AT_ONCE):
            for each in self._saving(every[start : start + AT_ONCE]):
                if (saved := self._confirmed(each.change)) >= least:
                    return Saving(each.text, saved, unchanged, len(self.seeds), instead)
        return Saving("", 0, unchanged, len(self.seeds), instead)

    def _limits(self) -> tuple[list[Adjustable], str]:
        """Return the limits that end the run, each after those before it no longer do.

        Also the end of the run with the extreme values of all.
        """
        limits: dict[str, Adjustable] = {}
        end: Report | None = self.end
        instead = ""
        while end is not None:
            found = {each.key: each for each in limits_of(end, self.settings)}
            if found.keys() <= limits.keys():
                return [], instead
            limits |= found
            (verdict,) = self.play([candidate([*limits.values()], FACTORS[-1]).change])
            instead, end = verdict.text, verdict.end if verdict.text else None
        return [*limits.values()], instead

    def _saving(self, tried: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates that save the run as recorded."""
        verdicts = self.play([each.change for each in tried]) if tried else []
        return [each for each, its in zip(tried, verdicts, strict=True) if not its.text]

    def _confirmed(self, change: Change) -> int:
        verdicts = self.play([replace(change, seed=seed) for seed in self.seeds])
        return sum(not each.text for each in verdicts)


@dataclass(frozen=True, slots=True)
class SaveAnswer:
    """Answer of `rover whatif --save`.

    Attributes:
        command: the failed command and its end.
        fidelity: of the fork without a change.
        hypotheses: faults that may explain a recording with an unknown one, the best first.
        saving: None if no hypothesis explains the recording.
    """

    recording: str
    command: str
    fidelity: Fidelity
    hypotheses: tuple[Hypothesis, ...]
    saving: Saving | None

    def document(self) -> dict[str, Any]:
        """Return it as JSON data."""
        hypotheses = [each.document() for each in self.hypotheses]
        return asdict(self) | {"fidelity": self.fidelity.name, "hypotheses": hypotheses}

    def lines(self) -> Iterator[str]:
        """Yield it as text."""
        yield self.command
        if self.hypotheses:
            yield "a fork without a change ends otherwise; faults that may explain the recording:"
            yield from (f"  {each}" for each in self.hypotheses)
        found = self.saving
        if found is None:
            yield f"none explains it (a score up to {EXPLAINED:g} does): no change was tried"
            return
        if found.minimal:
            yield f"saved by {found.minimal}"
            yield f"  EXECUTED with {found.saved} of {found.seeds} seeds"
        else:
            yield "no change of limits, speeds, controller or arguments saves it"
            yield from [f"  with extreme limits: {found.instead}"] if found.instead else []
        yield f"  EXECUTED without a change with {found.saved_unchanged} of {found.seeds} seeds"


def save(path: Path, seeds: Sequence[int]) -> SaveAnswer:
    """Return the minimal change that saves the first command of a recording that failed.

    Raises:
        RecordingError: it is no recording that can be forked.
        ValueError: no command failed.
    """
    forkable = Forkable(path)
    recorded = forkable.recorded
    requests = {each.identity: each.request for each in recorded.record.requested}
    commands = recorded.record.all_lifecycles().items()
    ends = ((i, each.end) for i, each in commands if i in requests)
    failed = [(i, end) for i, end in ends if end and end.stage in (Stage.FAILED, Stage.REJECTED)]
    if not failed:
        raise ValueError(f"{path}: none of its commands failed; there is nothing to save")
    identity, end = failed[0]
    request, settings = requests[identity], forkable.settings
    command = f"{identity} {declaration_of(type(request)).name} {_end_text(end)}"
    unchanged, fidelity = forkable.unchanged(None)
    ranked: list[Hypothesis] = []
    if fidelity is Fidelity.DIFFERENT:

        def scores(changes: Sequence[Change], at_s: float) -> list[float]:
            runs = _forks(forkable, changes, at_s)
            return [inf if each is None else score(recorded, each) for each in runs]

        ranked = rank(recorded, unchanged, settings, scores)[:SHOWN]
        if ranked[0].score > EXPLAINED:
            return SaveAnswer(str(path), command, fidelity, tuple(ranked), None)
    faults = tuple(each.fault for each in ranked[:1])
    as_was = replace(recorded.record, contacts=None if ranked else unchanged.record.contacts)

    def play(changes: Sequence[Change]) -> list[Verdict]:
        runs = _forks(forkable, [replace(each, faults=faults) for each in changes])
        refused = Verdict("the settings refuse it")
        return [judge(identity, as_was, each.record) if each else refused for each in runs]

    search = Search(identity, end, request, settings, play, seeds)
    return SaveAnswer(str(path), command, fidelity, tuple(ranked), search.run())


def _forks(
    forkable: Forkable, changes: Sequence[Change], at_s: float | None = None
) -> list[ForkRun | None]:
    """Return forks, made in a process on each core; None for a change that the settings refuse."""
    # The processes inherit the recording by their fork: it is not pickled.
    forking, cores = get_context("fork"), len(sched_getaffinity(0))
    with ProcessPoolExecutor(cores, forking, _inherited.append, (forkable,)) as pool:
        return list(pool.map(_fork, changes, repeat(at_s)))


_inherited: list[Forkable] = []


def _fork(change: Change, at_s: float | None) -> ForkRun | None:
    try:
        return _inherited[0].fork(change, at_s)
    except SettingsError:
        return None
