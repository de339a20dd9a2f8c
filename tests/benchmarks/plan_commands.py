"""`rover bench`: the benchmarks and attacks of plans."""

from typing import TYPE_CHECKING

from tests.benchmarks.command_group import SEED, benchmark, count, log

if TYPE_CHECKING:
    from tests.support.figures import Figure


@benchmark("plan-traces --plans 1000", count("--plans", 30_000), SEED)
def plan_traces(count: int, seed: int) -> "list[Figure]":
    """Random plans against the recorded traces of BehaviorTree.CPP 4.10."""
    from tests.stress import plan_traces

    log(f"plan traces: {count} plans ...")
    return plan_traces.measure(count, seed, log)


@benchmark("plan-tick", count("--batches", 100))
def plan_tick(count: int) -> "list[Figure]":
    """The tick of a plan of 300 nodes, its state, and the stored text."""
    from tests.benchmarks import plan_tick

    return plan_tick.measure(count)


@benchmark("plan-kills --kills 200", count("--kills", 2_000), SEED)
def plan_kills(count: int, seed: int) -> "list[Figure]":
    """Missions, killed after any tick and anywhere in a commit: is each done as undisturbed?"""
    from tests.stress import plan_causes, plan_kills

    log(f"plan kills: {count}, in lock step ...")
    return [*plan_kills.measure(count, seed, log), *plan_causes.measure(seed, log)]


@benchmark("plan-days --days 1", count("--days", 10), SEED)
def plan_days(count: int, seed: int) -> "list[Figure]":
    """Days on one uplink: which goals does the plan reach, by the truth? (minutes a day).

    Each day has twelve passes, three unknown obstacles, a fault and a night. It is played by a
    script that knows them and has a direct link, by config/plans/day.xml, and by a fixed list.
    """
    from tests.stress import plan_day

    log(f"plan days: {count} days ...")
    return plan_day.measure(count, seed, log)
