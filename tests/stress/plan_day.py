"""Days on one uplink: how many goals does the plan reach, of those that foreknowledge reaches?

A day is played three times: by a script that knows obstacles, fault and link in advance and
commands over a direct link; by `config/plans/day.xml`, uplinked once over the relay; and by a fixed
list, uplinked likewise. Each goal is judged by the true state of the rover.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from typing import Final

from executive.commands import PlanDefinition
from tests.simulated.day import DayScene, draw_day
from tests.simulated.day_conduct import Foreknowing, fixed_list
from tests.simulated.day_goals import judge
from tests.stress.findings import Log
from tests.support.figures import Figure, Goal

PLAN: Final = Path(__file__).resolve().parents[2] / "config/plans/day.xml"
LEAST_SHARE: Final = 0.95
WORKERS: Final = 2


@unique
class Conduct(Enum):
    """The command source of a day."""

    FOREKNOWING = "foreknowledge, direct link"
    PLAN = "plan, one uplink"
    LIST = "fixed list, one uplink"
    LENIENT_LIST = "fixed list that ignores failures, one uplink"


@dataclass(frozen=True, slots=True)
class PlayedDay:
    """The goals of a day that was played.

    Attributes:
        reached, missed: names of the goals.
    """

    seed: int
    conduct: Conduct
    reached: tuple[str, ...]
    missed: tuple[str, ...]

    def __str__(self) -> str:
        of = len(self.reached) + len(self.missed)
        missed = f"; missed: {', '.join(self.missed)}" if self.missed else ""
        return f"day {self.seed}, {self.conduct.value}: {len(self.reached)} of {of}{missed}"


def play_day(seed: int, conduct: Conduct, plan: bytes | None = None) -> PlayedDay:
    """Play a day, and return which goals were reached.

    Args:
        plan: the text of the plan; None for that of the configuration.
    """
    day = draw_day(seed)
    match conduct:
        case Conduct.FOREKNOWING:
            uplinked = None
        case Conduct.PLAN:
            content = PLAN.read_bytes() if plan is None else plan
            uplinked = PlanDefinition("day", "day", "BTCPP4", content)
        case _:
            uplinked = fixed_list(day, ignores_failures=conduct is Conduct.LENIENT_LIST)
    direct = None if uplinked else (lambda process, scene: Foreknowing(scene).start(process))
    with DayScene(day, None, uplinked, direct) as scene:
        scene.play()
        goals = judge(scene)
    reached = tuple(goal.name for goal in goals if goal.reached)
    return PlayedDay(seed, conduct, reached, tuple(g.name for g in goals if not g.reached))


def measure(count: int, seed: int, log: Log) -> list[Figure]:
    """Return the shares of the goals that are reached.

    Args:
        count: days.
        seed: of the first day.
        log: called with a line on each day that was played.
    """
    played = list(_play_all(range(seed, seed + count), log))
    totals = {
        conduct: sum(len(each.reached) for each in played if each.conduct is conduct)
        for conduct in Conduct
    }
    best = {each.seed: len(each.reached) for each in played if each.conduct is Conduct.FOREKNOWING}
    shares = [
        len(each.reached) / best[each.seed] for each in played if each.conduct is Conduct.PLAN
    ]
    beside = f"{count} days, seed {seed}"
    goal, share = Goal(LEAST_SHARE, at_least=True), "goals: plan, of foreknowledge"
    return [
        *(Figure(f"goals: {each.value}", totals[each], "goals", beside) for each in Conduct),
        Figure(share, totals[Conduct.PLAN] / totals[Conduct.FOREKNOWING], "", beside, goal),
        Figure(f"{share}, worst day", min(shares), "", beside),
    ]


def _play_all(seeds: range, log: Log) -> Iterator[PlayedDay]:
    pairs = [(seed, conduct) for seed in seeds for conduct in Conduct]
    with ProcessPoolExecutor(min(WORKERS, os.cpu_count() or 1)) as pool:
        for each in pool.map(play_day, *zip(*pairs, strict=True)):
            log(str(each))
            yield each
