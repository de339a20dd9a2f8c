"""Short workloads for `pairs.py`, in CPU time of this process: `python -P probes.py`.

Run by its path with the product of one of two trees. A workload that needs a name that the tree
does not have, or a package that is not installed, has no figure. Prints a JSON object: figure by
name.
"""

import json
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

NODES: Final = 40
TICKS: Final = 20_000
REST_S: Final = 60.0
REPEATS: Final = 3
"""Of a workload in one process; the least time counts, since the first fills caches."""


def imports_aboard_ms() -> float:
    """Import what `rover-executive` imports."""
    import adapters.onboard.service as service

    del service
    return 1e3 * time.process_time()


def tick_us() -> float:
    """Tick a tree of 40 nodes, in which the last leaf alone succeeds."""
    from trees.composites import Selector, TickedNode
    from trees.leaf import Condition

    groups: list[TickedNode] = []
    for group in range(3):
        leaves = [Condition(f"never {group}.{leaf}", lambda: False) for leaf in range(11)]
        groups.append(Selector(f"group {group}", *leaves))
    groups += [Condition(f"never {leaf}", lambda: False) for leaf in range(2)]
    root = Selector("root", *groups, Condition("rest", lambda: True))
    assert len(list(root.iterate())) == NODES, "as in the name of the figure"
    return 1e6 * _least_s(lambda: root.run([]), TICKS)


def peer_tick_us() -> float:
    """Tick a tree of the same shape in BehaviorTree.CPP, with leaves in Python."""
    peer = import_module("behaviortreepy")  # by hand: pip install behaviortreepy
    factory, status = peer.BehaviorTreeFactory(), peer.NodeStatus
    factory.register_simple_condition("Never", lambda _node: status.FAILURE)
    factory.register_simple_condition("Rest", lambda _node: status.SUCCESS)
    group = f"<Fallback>{'<Never/>' * 11}</Fallback>"
    root = f"<ReactiveFallback>{group * 3}<Never/><Never/><Rest/></ReactiveFallback>"
    text = f'<root BTCPP_format="4"><BehaviorTree ID="main">{root}</BehaviorTree></root>'
    factory.register_behavior_tree_from_text(text)
    tree = factory.create_tree("main")
    return 1e6 * _least_s(tree.tick_once, TICKS)


def rest_ms() -> float:
    """Play a minute of a rover at rest in lock step: ms for each simulated second."""
    from executive.settings import load_settings
    from sim.rover.lockstep import LockStep
    from sim.rover.world import World

    with TemporaryDirectory() as folder:
        lock = LockStep(load_settings("jackal"), World(), Path(folder))
        lock.run(1.0)
        return 1e3 * _least_s(lambda: lock.run(REST_S)) / REST_S


def physics_ms() -> float:
    """Advance the same rover's physics alone."""
    import mujoco

    from executive.settings import load_settings
    from sim.rover.lockstep import STEP_S, LockStep
    from sim.rover.world import World

    with TemporaryDirectory() as folder:
        rover = LockStep(load_settings("jackal"), World(), Path(folder)).rover
        each_s = rover.model.opt.timestep
        one = partial(mujoco.mj_step, rover.model, rover.data, round(STEP_S / each_s))
        return 1e3 * _least_s(one, round(REST_S / STEP_S)) / STEP_S


def scenario_ms(name: str) -> float:
    """Play a scenario in lock step, the making of its rover included: ms for a simulated second."""
    from sim.scenario.model import RunMode
    from sim.scenario.reading import load_scenario
    from sim.scenario.run import run_scenario

    scenario = load_scenario(name, RunMode.LOCK_STEP)
    play = partial(run_scenario, name, scenario, RunMode.LOCK_STEP)
    return 1e3 * _least_s(play) / scenario.duration_s


PROBES: Final[dict[str, Callable[[], float]]] = {
    "imports aboard, ms": imports_aboard_ms,
    "tick of 40 nodes, µs": tick_us,
    "tick in BehaviorTree.CPP, µs": peer_tick_us,
    "lock step at rest, ms": rest_ms,
    "mj_step alone, ms": physics_ms,
    "lock step of a path, ms": partial(scenario_ms, "motion_path"),
    "lock step with a laser, ms": partial(scenario_ms, "unknown_rocks"),
}
"""The imports are first, since all others import, too."""


def _least_s(work: Callable[[], object], times: int = 1) -> float:
    return min(_took_s(work, times) for _ in range(REPEATS))


def _took_s(work: Callable[[], object], times: int) -> float:
    began_s = time.process_time()
    for _ in range(times):
        work()
    return (time.process_time() - began_s) / times


def main() -> None:
    """Print the figures of all workloads that this tree can play."""
    figures = {}
    for name, probe in PROBES.items():
        try:
            figures[name] = probe()
        except (ImportError, AttributeError, TypeError) as error:
            print(f"  {name}: not measured: {error}", file=sys.stderr)
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
