"""`execute`: runs the draws of a trial, here or on all cores, then the worst of them again."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from executive.settings import SettingsError
from sim.campaign.model import Variation
from sim.campaign.reading import load_campaign, read_vary
from sim.scenario.changes import Override
from sim.trial.report import TrialReport, WorstRun, report_of, worst_of
from sim.trial.run import Trial, TrialResult, begin_utc_s, checked_plan, try_once

FEW: Final = 8
"""Number of draws below which this process executes them: a cluster takes seconds to start."""
_ALWAYS: Final[dict[str, Any]] = {
    "seed": {"integers": [0, 1_000_000]},
    "inject": {"choice": ["none", {"odometry_jitter": {"stall": 0.2}}], "at": 0.5},
    "world.friction": {"uniform": [0.45, 0.75]},
}
"""Varied keys, as those of config/campaigns/normal.yaml."""
_HILLS: Final[dict[str, Any]] = {
    "world.ground.amplitude": {"uniform": [0.0, 0.08]},
    "world.ground.seed": {"integers": [0, 1_000_000]},
}
"""Hills up to those of config/worlds/rough.yaml, unless a world is given."""


def usual_vary(scenario: str | None, changes: Sequence[Override]) -> tuple[Variation, ...]:
    """Return the varied keys without a campaign, except those that are set for all runs."""
    given = {change.key for change in changes}
    has_world = scenario is not None or "world" in given
    keys = _ALWAYS if has_world else _ALWAYS | _HILLS
    return read_vary({key: drawn for key, drawn in keys.items() if key not in given})


def campaign_vary(name: str) -> tuple[Variation, ...]:
    """Return the varied keys of a campaign, except those of its scenario's commands.

    Raises:
        SettingsError: the campaign cannot be used.
    """
    vary = load_campaign(name).vary
    return tuple(each for each in vary if not each.key.startswith("command."))


def execute(
    trial: Trial, numbers: Sequence[int], jobs: int | None, out: Path | None, repeat: str
) -> TrialReport:
    """Run the draws with these numbers, at least one; write the files of the worst.

    Args:
        trial: the plan and its conditions.
        numbers: numbers of the draws.
        jobs: number of parallel runs; None for all cores if there are many draws.
        out: folder of the files; None for none.
        repeat: command line of the trial, without a draw.

    Raises:
        PlanRefusedError: the plan would be refused.
        SettingsError: a value does not fit.
        sim.campaign.cluster.ClusterError: a worker is lost.
    """
    root = checked_plan(trial)
    if out is not None and len(numbers) == 1:
        runs = [try_once(trial, numbers[0], _folder(out, numbers[0]))]
    else:
        runs = sorted(_results(trial, numbers, jobs), key=lambda run: run.draw)
    worst = worst_of(runs)
    folder = None if out is None else _folder(out, worst.draw)
    if len(runs) > 1 and folder is not None and try_once(trial, worst.draw, folder) != worst:
        raise SettingsError(f"draw {worst.draw}, repeated, was not identical bit for bit")
    described = WorstRun(
        draw=worst.draw,
        completed=worst.completed,
        status=worst.status.name,
        reason=worst.reason,
        clearance_m=worst.clearance_m,
        digest=worst.digest,
        command=f"{repeat} --draw {worst.draw}",
        folder="" if folder is None else str(folder),
    )
    begin = begin_utc_s(root, trial.begin_utc_s)
    return report_of(trial.plan.plan_id, root, begin, runs, described)


def _folder(out: Path, number: int) -> Path:
    return out / f"draw-{number}"


def _results(trial: Trial, numbers: Sequence[int], jobs: int | None) -> Iterator[TrialResult]:
    play: Callable[[int], TrialResult] = partial(try_once, trial)
    if jobs == 1 or len(numbers) < FEW:
        yield from map(play, numbers)
        return
    from sim.campaign.cluster import cores, local_cluster, results  # takes seconds

    wanted = min(jobs or cores(), len(numbers))
    with local_cluster(wanted) as client:
        yield from results(client, play, numbers)
