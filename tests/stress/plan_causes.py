"""Missions that must not continue by themselves after a kill: another cause holds the rover.

Each cause once in each situation, in the middle of the mission. The operators end it, and resume.
"""

import tempfile
from collections.abc import Sequence
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Any, Final

from executive.commands import ConfirmPose, Resume, Stop
from executive.plans import FINAL_STATUSES
from executive.values.geometry import STANDING, Pose
from executive.values.reasons import Reason, Refusal
from executive.values.reports import PlanStatus
from tests.stress.findings import Findings, Log
from tests.stress.plan_kills import (
    MAX_TICKS,
    Continued,
    Kill,
    Killed,
    Watch,
    undisturbed,
    write,
)
from tests.support.figures import Figure
from tests.support.kinematic import STEP_S
from tests.support.mission_bench import SITUATIONS, MissionBench, Situation, World

HELD_S: Final = 2.0
UNKNOWN_S: Final = 61.0
"""Time after which a plan does not wait for its position any longer."""
LOW_RATIO: Final = 0.1001
"""Charge that is only just above the reserve."""


@unique
class Cause(Enum):
    """Why a plan must not continue by itself."""

    MOVED = "moved by 2 m"
    FAULT = "a fault"
    STOP = "a stop"
    UNKNOWN = "position not known for a minute"
    BATTERY = "low battery"


@unique
class Held(Enum):
    """What no cause may have."""

    CONTINUES = "plans that continued by themselves in spite of a cause"
    END = "plans that were not done after a cause had ended"


class _HeldBench(MissionBench):
    """A rover on a mission that a cause holds from the start of its process on.

    Attributes:
        cause: None once it has ended.
    """

    cause: Cause | None

    def __init__(self, *args: Any, cause: Cause) -> None:
        self.cause, self._began = cause, False
        super().__init__(*args)

    def step(self) -> None:
        """Let one tick pass, with the cause."""
        first, self._began = not self._began, True
        self.odometry = self.cause is not Cause.UNKNOWN
        self.charge_ratio = LOW_RATIO if self.cause is Cause.BATTERY else 0.9
        if first and self.cause is Cause.FAULT:
            self.executive.enter_safe_mode(Refusal(Reason.LEAF_RAISED, "a fault of a test"))
        if first and self.cause is Cause.STOP:
            assert self.order(Stop(), 50)
        super().step()
        self.note()

    def has_report(self, text: str = "") -> bool:
        """Return whether a report on insufficient energy has this text."""
        low = (each for each in self.received.reports if each.reason is Reason.BATTERY_INSUFFICIENT)
        return any(text in each.text for each in low)

    def end_cause(self) -> None:
        """End the cause, as operators do."""
        held = self.cause in {Cause.FAULT, Cause.STOP}
        self.cause = None
        for _ in range(round(HELD_S / STEP_S)):
            self.step()
        if held:
            assert self.order(Resume(), 51)
        if self.executive.status.uncertainty:
            assert self.order(ConfirmPose(0.0, 0.0), 52)


def check_causes(
    seed: int, log: Log, situations: Sequence[Situation] = SITUATIONS
) -> tuple[Findings, int]:
    """Return what broke, and the number of kills."""
    findings, kills = Findings(log), 0
    for situation in situations:
        random = Random(f"{seed} {situation.name}")
        reference = undisturbed(situation, True, Watch({}, random))
        at = random.randrange(reference.ticks // 3, reference.ticks * 2 // 3)
        watch = Watch({(False, at): [Kill.AFTER_TICK]}, random)
        undisturbed(situation, True, watch)
        for cause in Cause:
            with tempfile.TemporaryDirectory() as folder:
                run = Continued(situation, True, reference, random, findings.add)
                _check(watch.taken[0], cause, run, Path(folder), findings)
            kills += 1
    return findings, kills


def _check(killed: Killed, cause: Cause, run: Continued, folder: Path, findings: Findings) -> None:
    write(killed.files, folder)
    rover, reference = killed.world.rover, run.reference
    rover.velocity, pose = STANDING, rover.pose
    about = f"{run.situation.name}: {cause.value}"
    run.before = list(reference.trace[: killed.world.changes])
    if cause is Cause.MOVED:
        rover.pose = Pose(pose.x_m, pose.y_m + 2.0, heading_rad=pose.heading_rad)
    world = World(rover, killed.world.now_s, 0)
    with _HeldBench(folder, run.situation, True, world, cause=cause) as bench:
        rover.pose = pose
        held_s = UNKNOWN_S if cause is Cause.UNKNOWN else HELD_S
        for _ in range(round(held_s / STEP_S)):
            bench.step()
        suspended = bench.plan_status is PlanStatus.SUSPENDED
        if cause is Cause.BATTERY and not bench.has_report("does not continue by itself"):
            if bench.has_report():
                return  # a step was refused that is behind a decision, or has variables
            suspended = True  # it suffices for the rest
        if not suspended or (cause is not Cause.BATTERY and bench.rover.velocity != STANDING):
            findings.add(Held.CONTINUES, about)
        if cause is Cause.MOVED or not suspended:
            return
        bench.end_cause()
        if bench.plan_status is PlanStatus.SUSPENDED:
            bench.resume(53)
        watch = Watch({}, run.random)
        while bench.plan_status not in FINAL_STATUSES and watch.ticks < MAX_TICKS:
            bench.proceed()
            watch.on_tick(bench)
        if bench.plan_status is not reference.status:
            findings.add(Held.END, f"{about}: {bench.plan_status}")
        else:
            run.compare(bench, watch)


def measure(seed: int, log: Log) -> list[Figure]:
    """Return what the causes broke."""
    findings, kills = check_causes(seed, log)
    beside = f"each of {len(Cause)} causes in {len(SITUATIONS)} situations"
    return [
        Figure("plan causes: kills", kills, "", beside),
        *findings.figures("plan causes", Held, beside),
    ]
