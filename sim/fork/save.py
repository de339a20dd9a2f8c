"""`save`: the minimal change that makes a failed run succeed, confirmed with other noise.

Limits are tried at their extreme values first: if these do not save the run, nearer ones do not.
If the fork without a change differs from the recording, a fault is unknown: hypotheses are ranked,
and the run is saved under the best one if that explains it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from math import ceil, inf
from multiprocessing import get_context
from os import sched_getaffinity
from pathlib import Path
from typing import Any, Final, TypeVar

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
from sim.fork.model import AddedFault, Change, Fidelity, ForkRun
from sim.scenario.record import Record
from sim.scenario.truth import check_executed_truth

T = TypeVar("T")
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
        end: last report of the command; None without one.
    """

    text: str
    end: Report | None

    @property
    def saved(self) -> bool:
        """Whether the command succeeded, and nothing else became worse."""
        return not self.text


Trial = tuple[Change, int | None]
"""A change, and a seed of the noise; None for the recorded noise."""
Play = Callable[[Sequence[Trial]], Sequence[Verdict]]
"""Repeats a run with each change."""


def judge(failed: Identity, recorded: Record, played: Record) -> Verdict:
    """Judge a repeated run as scenarios do.

    It is saved if the command ended EXECUTED, every EXECUTED is true, the contacts do not increase,
    and every other command that ended EXECUTED in the recording does so. A fork may begin in the
    middle of a run.
    """
    before, after = recorded.all_lifecycles(), played.all_lifecycles()
    lost = [each for each in before if _executed(before, each) and not _executed(after, each)]
    stages = after[failed].stages if failed in after else ()
    end = stages[-1] if stages else None
    begun = [each for each in recorded.requested if each not in played.requested]
    began_s = played.poses[0].time_s if played.poses else inf
    poses = [each for each in recorded.poses if each.time_s < began_s]  # from before the fork
    whole = replace(played, requested=[*begun, *played.requested], poses=[*poses, *played.poses])
    true = check_executed_truth(whole, ())
    if end is None or end.stage is not Stage.EXECUTED:
        return Verdict(f"{failed} {_end_text(end)}", end)
    if lost:
        return Verdict(f"{lost[0]} no longer ends EXECUTED", end)
    if not true.passed:
        return Verdict(f"EXECUTED is not true: {true.observed}", end)
    if (played.contacts or 0) > (recorded.contacts or 0):
        return Verdict(f"{played.contacts} contacts", end)
    return Verdict("", end)


def _executed(commands: Mapping[Identity, CommandHistory], identity: Identity) -> bool:
    end = commands[identity].end if identity in commands else None
    return end is not None and end.stage is Stage.EXECUTED


def _end_text(end: Report | None) -> str:
    if end is None or end.stage is None:
        return "has no end"
    return f"{end.stage.name} {end.reason.name}" if end.reason else end.stage.name


@dataclass(frozen=True, slots=True)
class Saving:
    """What would have saved a run.

    Attributes:
        command: the failed command and its end.
        minimal: the minimal change that does, as text; empty if none does.
        saved, saved_unchanged: numbers of seeds that succeed with it and without it.
        instead: end of the run with the extreme values of the limits that ended it.
    """

    command: str
    minimal: str
    saved: int
    saved_unchanged: int
    seeds: int
    tried: int
    instead: str

    def lines(self) -> Iterator[str]:
        """Yield it as text."""
        unchanged = f"without a change in {self.saved_unchanged} of {self.seeds}"
        yield self.command
        if self.minimal:
            yield f"saved by {self.minimal}"
            yield f"  EXECUTED with {self.saved} of {self.seeds} seeds, {unchanged}"
            return
        yield "no change of limits, speeds, controller or arguments saves it"
        yield f"  {self.tried} runs; EXECUTED {unchanged} seeds"
        if self.instead:
            yield f"  with extreme limits: {self.instead}"


@dataclass(slots=True)
class Search:
    """A search for the minimal change that saves a run.

    Attributes:
        failed, end, request: the command that failed, its last report, and its request.
        play: repeats the run, also with the seeds that confirm a change.
        tried, instead: as in `Saving`.
    """

    failed: Identity
    end: Report
    request: Request
    settings: Settings
    play: Play
    seeds: Sequence[int]
    tried: int = 0
    instead: str = ""

    def run(self) -> Saving:
        """Return the minimal change that saves the run with enough of the seeds."""
        unchanged = self._confirmed(Change())
        found = next(self._confirmations(max(unchanged, ceil(CONFIRMED * len(self.seeds)))), None)
        text, saved = (found[0].text, found[1]) if found else ("", 0)
        command = f"{self.failed} {declaration_of(type(self.request)).name} {_end_text(self.end)}"
        seeds = len(self.seeds)
        return Saving(command, text, saved, unchanged, seeds, self.tried, self.instead)

    def _confirmations(self, least: int) -> Iterator[tuple[Candidate, int]]:
        """Yield what saves the run as recorded and with enough seeds, the minimal first."""
        for group in self._groups():
            ordered = sorted(group, key=lambda each: each.order)
            for start in range(0, len(ordered), AT_ONCE):
                for each in self._saving(ordered[start : start + AT_ONCE]):
                    if (saved := self._confirmed(each.change)) >= least:
                        yield each, saved

    def _groups(self) -> Iterator[list[Candidate]]:
        """Yield candidates in groups, each smaller than those after it."""
        limits = self._limits()
        others = candidates([each] for each in speeds_of(self.settings))
        others += controllers_for(self.request, self.settings)
        for together in range(1, MAX_TOGETHER + 1):
            figures = [*combinations(limits, together)]
            extreme = [candidate(each, FACTORS[-1]) for each in figures]
            saving = self._saving(extreme)
            pairs = zip(figures, extreme, strict=True)
            yield [*others, *candidates(each for each, far in pairs if far in saving)]
            others = []
        yield candidates([each] for each in arguments_of(self.failed, self.request))

    def _limits(self) -> list[Adjustable]:
        """Return the limits that end the run, each after those before it no longer do."""
        limits: dict[str, Adjustable] = {}
        end: Report | None = self.end
        while end is not None:
            found = {each.key: each for each in limits_of(end, self.settings)}
            if found.keys() <= limits.keys():
                return []
            limits |= found
            (verdict,) = self._run([(candidate([*limits.values()], FACTORS[-1]).change, None)])
            if verdict.saved:
                break
            self.instead, end = verdict.text, verdict.end
        return [*limits.values()]

    def _saving(self, tried: Sequence[Candidate]) -> list[Candidate]:
        """Return the candidates that save the run as recorded."""
        verdicts = self._run([(each.change, None) for each in tried])
        return [each for each, its in zip(tried, verdicts, strict=True) if its.saved]

    def _confirmed(self, change: Change) -> int:
        return sum(each.saved for each in self._run([(change, seed) for seed in self.seeds]))

    def _run(self, trials: Sequence[Trial]) -> Sequence[Verdict]:
        self.tried += len(trials)
        return self.play(trials) if trials else []


@dataclass(frozen=True, slots=True)
class SaveAnswer:
    """Answer of `rover whatif --save`.

    Attributes:
        fidelity: of the fork without a change.
        hypotheses: faults that may explain a recording with an unknown one, the best first.
        saving: None if no hypothesis explains the recording.
    """

    recording: str
    fidelity: Fidelity
    hypotheses: tuple[Hypothesis, ...]
    saving: Saving | None

    def document(self) -> dict[str, Any]:
        """Return it as JSON data."""
        return {
            "recording": self.recording,
            "fidelity": self.fidelity.name,
            "hypotheses": [each.document() for each in self.hypotheses],
            "saving": None if self.saving is None else asdict(self.saving),
        }

    def lines(self) -> Iterator[str]:
        """Yield it as text."""
        if self.hypotheses:
            yield "a fork without a change ends otherwise; faults that may explain the recording:"
            yield from (f"  {each}" for each in self.hypotheses)
        if self.saving is None:
            yield f"none explains it (a score up to {EXPLAINED:g} does): no change was tried"
        else:
            yield from self.saving.lines()


def save(path: Path, seeds: Sequence[int]) -> SaveAnswer:
    """Return the minimal change that saves the first command of a recording that failed.

    Raises:
        RecordingError: it is no recording that can be forked.
        ValueError: no command failed.
    """
    forkable = Forkable(path)
    recorded = forkable.recorded
    ends = ((i, each.end) for i, each in recorded.record.all_lifecycles().items())
    failed = [(i, end) for i, end in ends if end and end.stage in (Stage.FAILED, Stage.REJECTED)]
    requests = {each.identity: each.request for each in recorded.record.requested}
    if not failed:
        raise ValueError(f"{path}: no command failed or was rejected; there is nothing to save")
    identity, end = failed[0]
    unchanged, fidelity = forkable.unchanged(None)
    ranked: list[Hypothesis] = []
    if fidelity is Fidelity.DIFFERENT:

        def scores(changes: Sequence[Change], at_s: float) -> list[float]:
            forks = _forks(forkable, lambda run: score(recorded, run), inf, at_s=at_s)
            return forks([(each, None) for each in changes])

        ranked = rank(recorded, unchanged, forkable.settings, scores)[:SHOWN]
        if ranked[0].score > EXPLAINED:
            return SaveAnswer(str(path), fidelity, tuple(ranked), None)
    faults = tuple(each.fault for each in ranked[:1])
    as_was = replace(
        recorded.record,
        poses=recorded.record.poses or list(recorded.odometry),
        contacts=None if ranked else unchanged.record.contacts,
    )
    refused = Verdict("the settings refuse it", None)
    play = _forks(forkable, lambda run: judge(identity, as_was, run.record), refused, faults)
    search = Search(identity, end, requests[identity], forkable.settings, play, seeds)
    return SaveAnswer(str(path), fidelity, tuple(ranked), search.run())


def _forks(
    forkable: Forkable,
    judged: Callable[[ForkRun], T],
    refused: T,
    faults: tuple[AddedFault, ...] = (),
    at_s: float | None = None,
) -> Callable[[Sequence[Trial]], list[T]]:
    """Return a function that makes forks in a process on each core, and judges them there.

    A change that the settings refuse has the result `refused`; all forks have the faults.
    """

    def result(trial: Trial) -> T:
        change, seed = trial
        changed = replace(change, faults=(*change.faults, *faults), seed=seed)
        try:
            return judged(forkable.fork(changed, at_s))
        except SettingsError:
            return refused

    def results(trials: Sequence[Trial]) -> list[T]:
        # The processes inherit the recording by the fork: neither it nor the function is pickled.
        forking = get_context("fork")
        with ProcessPoolExecutor(len(sched_getaffinity(0)), forking, _adopt, (result,)) as pool:
            return list(pool.map(_run, trials))

    return results


_results: list[Callable[[Trial], Any]] = []


def _adopt(result: Callable[[Trial], Any]) -> None:
    _results.append(result)


def _run(trial: Trial) -> Any:
    return _results[0](trial)
