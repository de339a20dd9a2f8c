"""`drive_pattern` drives the calibration pattern with a simulated rover in lock step, recorded."""

import tempfile
from contextlib import closing
from pathlib import Path
from typing import Final

from adapters.calibration import plan_xml
from adapters.recording import RunFile
from executive.commands import ActivatePlan, Command, PlanDefinition, SubmitPlan
from executive.plans import FINAL_STATUSES, FORMAT
from executive.settings import Settings
from executive.values.reports import Identity, PlanStatus, PlanUpdate
from sim.rover import World
from sim.rover.lockstep import LockStep

PLAN: Final = "calibration"
REST_S: Final = 1.0
TIMEOUT_S: Final = 300.0


def drive_pattern(settings: Settings, recording: Path, cargo_kg: float, seed: int) -> None:
    """Drive on flat ground, and write the recording.

    Raises:
        RuntimeError: the plan did not complete; the text gives the cause.
    """
    definition = PlanDefinition(PLAN, PLAN, FORMAT, plan_xml(settings.drive).encode())
    with (
        tempfile.TemporaryDirectory(prefix="rover-calibrate-") as folder,
        closing(RunFile(recording)) as tape,
    ):
        lockstep = LockStep(settings, World(), Path(folder), seed, tape=tape)
        lockstep.rover.set_cargo_mass(cargo_kg)
        lockstep.run(REST_S)
        lockstep.submit(Command(Identity(PLAN, 1), SubmitPlan(definition), "direct"))
        lockstep.submit(Command(Identity(PLAN, 2), ActivatePlan(PLAN), "direct"))
        lockstep.run_until(lambda: _plan(lockstep).status in FINAL_STATUSES, TIMEOUT_S)
        plan = _plan(lockstep)
        lockstep.executive.close()
    if plan.status is not PlanStatus.COMPLETED:
        raise RuntimeError(plan.text or f"the pattern is {plan.status.name} after {TIMEOUT_S:g} s")


def _plan(lockstep: LockStep) -> PlanUpdate:
    (plan,) = lockstep.executive.plans()
    return plan
