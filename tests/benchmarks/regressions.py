"""Planted changes of settings and of code: does `rover replay FOLDER` find each, and where first?

campaigns ──▶ recordings ──▶ replayed with each change ──▶ groups by the first different decision
"""

import copy
import tempfile
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from time import process_time
from typing import Any, Final
from unittest.mock import patch

from adapters.recording import SUFFIX, RunFile
from adapters.recording.regressions import compare
from executive.core.dispatcher import Dispatcher
from executive.motion import Arbiter
from executive.motion.velocity_control import DriveLaw, TurnLaw
from executive.safety import MONITORS
from executive.safety.safety import FaultMonitor
from executive.settings import Settings, structure, unstructure
from executive.state import Status
from executive.values.geometry import Velocity
from sim.campaign.draws import draw
from sim.campaign.reading import load_campaign
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from tests.stress.findings import Log
from tests.support.figures import Figure, Goal

WHOLE: Final = 100
"""Number of recordings that is enough to find each change."""
RUNS: Final = {
    "faults": 42,
    "normal": 16,
    "slopes": 10,
    "obstacles": 8,
    "after_faults": 8,
    "unknown_rocks": 6,
    "takeover": 6,
}
"""Campaigns, each with the number of its runs among a hundred; the others are `FAULTS`."""
FAULTS: Final = (
    ("motion_held", "command.go.travel=0.15", "inject={odometry_frozen, at: 3}"),
    ("motion_forward", "inject={odometry_jump: {by: 0.3}, at: 2}"),
    ("motion_goal", "inject={odometry_jump: {by: 0.4}, at: 2}"),
    ("motion_path", "inject={low_friction: {factor: 0.05}, at: 2}"),
)
"""Runs that are decided by a monitor that is hardly ever the first one in campaigns."""
APART: Final = 23
"""Distance of the numbers of runs: grids go by the number."""
DURATION_S: Final = 9.0
DURATIONS_S: Final = {"after_faults": 16.0, "obstacles": 13.0}
SENSORS: Final = "settings.sensors={second_odometry: {rate_hz: 2}, laser: {rate_hz: 10}}"
"""All runs have one rover, with all sensors."""
JOBS: Final = 2


@dataclass(frozen=True, slots=True)
class Plant:
    """A change: of keys of the settings, or of the code while `plant` is entered."""

    name: str
    keys: tuple[tuple[str, object], ...] = ()
    code: Callable[[], Any] | None = None
    alters: bool = True


@dataclass(frozen=True, slots=True)
class Found:
    """Recordings that decide differently, their first group, and the processor time."""

    different: int
    unusable: int
    groups: int
    first: str
    cpu_s: float


def _scaled(law: type[DriveLaw] | type[TurnLaw], factor: float) -> Any:
    intent = law.intent

    def less(self: Any, now_s: float) -> Velocity:
        wanted = intent(self, now_s)
        return replace(wanted, rotate_radps=factor * wanted.rotate_radps)

    return patch.object(law, "intent", less)


def _without_monitor(name: str) -> Any:
    return patch.dict(MONITORS, {name: lambda *_: None})


PLANTS: Final = (
    Plant("travel speed 0.9 m/s", (("drive.travel_speed_mps", 0.9),)),
    Plant("acceleration 0.8 m/s²", (("drive.travel_acceleration_mps2", 0.8),)),
    Plant("control point 0.05 m", (("turn_drive.control_point_m", 0.05),)),
    Plant("position tolerance 0.05 m", (("turn_drive.position_tolerance_m", 0.05),)),
    Plant("odometry_off_gyro warns", (("faults.odometry_off_gyro.reaction", "warn"),)),
    Plant("wheels_off_command above 0.2", (("faults.wheels_off_command.above", 0.2),)),
    Plant("odometry_stale above 0.15", (("faults.odometry_stale.above", 0.15),)),
    Plant("odometry_jumped above 0.5", (("faults.odometry_jumped.above", 0.5),)),
    Plant("obstacle_near below 0.6", (("faults.obstacle_near.below", 0.6),)),
    Plant("footprint 0.5 m wide", (("footprint.width_m", 0.5),)),
    Plant("steering gain − 1 %", code=partial(_scaled, DriveLaw, 0.99)),
    Plant("turning gain − 5 %", code=partial(_scaled, TurnLaw, 0.95)),
    Plant(
        "a stop does not latch", code=partial(patch.object, Arbiter, "stop", Arbiter.zero_velocity)
    ),
    Plant(
        "paths are not checked",
        code=partial(patch.object, Dispatcher, "_check_path", lambda *_: None),
    ),
    Plant(
        "the pose is not checked",
        code=partial(patch, "executive.core.dispatcher.check_pose", lambda *_: None),
    ),
    Plant("no monitor wheel_slip", code=partial(_without_monitor, "wheel_slip")),
    Plant("no monitor odometry_frozen", code=partial(_without_monitor, "odometry_frozen")),
    Plant(
        "one laser return is an obstacle",
        code=partial(
            patch,
            "executive.safety.surroundings._second_nearest",
            lambda spots: min(spots, key=lambda spot: spot.gap_m, default=None),
        ),
    ),
    Plant(
        "faults do not end",
        code=partial(patch.object, FaultMonitor, "_ended_faults", lambda *_: ()),
    ),
    Plant(
        "standing is not checked",
        code=partial(patch.object, Status, "standing", property(lambda _: True)),
    ),
    Plant("no change", alters=False),
    Plant("a setting that no run uses", (("drive.path_waypoints", 90),), alters=False),
    Plant(
        "a monitor's bound that no run reaches", (("faults.battery_low.below", 20.0),), alters=False
    ),
)


def measure(recordings: int, folder: Path | None, log: Log) -> list[Figure]:
    """Return the number of planted changes that are found.

    Args:
        recordings: number of recordings to make; at least one of each campaign.
        folder: of recordings, which are made if it is empty; None for a temporary one.
        log: called with a line on each change.
    """
    with tempfile.TemporaryDirectory(prefix="rover-regressions-") as scratch:
        runs = folder or Path(scratch)
        if not any(runs.glob(f"*{SUFFIX}")):
            log(f"regressions: recording {recordings} runs ...")
            record(runs, recordings)
        recordings = len([*runs.glob(f"*{SUFFIX}")])
        # Forked, so that each process plants the changes of the code in its own memory.
        with ProcessPoolExecutor(JOBS, get_context("fork")) as pool:
            found = []
            for plant, each in zip(
                PLANTS, pool.map(partial(_find, runs), range(len(PLANTS))), strict=True
            ):
                log(
                    f"{plant.name}: {each.different} of {recordings} differ"
                    f" in {each.groups} groups, {each.cpu_s:.0f} s of CPU; {each.first}"
                )
                found.append(each)
    return _figures(found, recordings)


def record(folder: Path, count: int) -> None:
    """Record runs of the campaigns in their proportion, and the chosen ones."""
    for name, share in RUNS.items():
        campaign = load_campaign(name)
        for run in range(max(1, share * count // WHOLE)):
            drawn = draw(campaign, run * APART)
            changes = [each for each in drawn.changes if each.key != "settings.sensors"]
            _record(folder / f"{name}-{run:02d}{SUFFIX}", drawn.scenario, changes, name)
    for run, (scenario, *texts) in enumerate(FAULTS[: len(FAULTS) * count // WHOLE]):
        _record(folder / f"chosen-{run:02d}{SUFFIX}", scenario, map(Override.parse, texts))


def _record(path: Path, name: str, changes: Iterable[Override], campaign: str = "") -> None:
    scenario = load_scenario(name, RunMode.LOCK_STEP, (*changes, Override.parse(SENSORS)))
    # Behind the reader, which refuses entries of the timeline after the end.
    scenario = replace(scenario, duration_s=DURATIONS_S.get(campaign, DURATION_S))
    with closing(RunFile(path)) as tape, tempfile.TemporaryDirectory() as data:
        run_in_lock_step(scenario, Path(data), tape)


def settings_of(keys: tuple[tuple[str, object], ...]) -> Settings | None:
    """Return the settings of the runs with other values of some keys; None without keys."""
    scenario = load_scenario("motion_goal", RunMode.LOCK_STEP, (Override.parse(SENSORS),))
    plain: Any = copy.deepcopy(unstructure(scenario.settings))
    for key, value in keys:
        *path, last = key.split(".")
        within = plain
        for part in path:
            within = within[part]
        assert within[last] != value
        within[last] = value
    return structure(plain, Settings, "planted") if keys else None


@contextmanager
def planted(plant: Plant) -> Iterator[Settings | None]:
    """Change the code within this context, and give the settings to replay with."""
    if plant.code is None:
        yield settings_of(plant.keys)
        return
    with plant.code():
        yield None


def _find(runs: Path, number: int) -> Found:
    plant, began_s = PLANTS[number], process_time()
    with planted(plant) as settings:
        found = compare(sorted(runs.glob(f"*{SUFFIX}")), settings, 1)
    first = ""
    if found.groups:
        group = found.groups[0]
        command, replayed, recorded = group.first.group
        where = f" where {recorded}" if recorded else ""
        first = f"{len(group.members)} × {command}: {replayed}{where}"
    different = len(found.compared) - found.same - len(found.unusable)
    return Found(different, len(found.unusable), len(found.groups), first, process_time() - began_s)


def _figures(found: list[Found], recordings: int) -> list[Figure]:
    changes = [each for plant, each in zip(PLANTS, found, strict=True) if plant.alters]
    others = [each for plant, each in zip(PLANTS, found, strict=True) if not plant.alters]
    beside = f"{recordings} recordings of campaigns, lock step"
    goal = Goal(len(changes), at_least=True) if recordings >= WHOLE else None
    cpu_s = sum(each.cpu_s for each in found) / len(found)
    return [
        Figure(
            "regressions: changes found",
            sum(each.different > 0 for each in changes),
            "",
            beside,
            goal,
        ),
        Figure("regressions: changes", len(changes), "", beside),
        Figure(
            "regressions: recordings that differ without a change",
            sum(each.different for each in others),
            "",
            f"{len(others)} changes that alter no decision",
            Goal(0),
        ),
        Figure(
            "regressions: recordings that cannot be used",
            sum(each.unusable for each in found),
            "",
            beside,
            Goal(0),
        ),
        Figure("regressions: processor time of a change", cpu_s, "s", beside),
    ]
