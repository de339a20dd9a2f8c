"""The plans of config/ on the simulated rover, in lock step."""

from pathlib import Path

import pytest

from executive.commands.catalogue import (
    ActivatePlan,
    Command,
    PlanDefinition,
    Request,
    ResumePlan,
    SubmitPlan,
)
from executive.commands.lifecycle import Accepted
from executive.settings import config_folder, load_settings
from executive.values.reports import Identity, PlanStatus
from sim.rover.lockstep import LockStep
from sim.rover.world import World
from tests.support.patience import shipped

PLANS = config_folder() / "plans"
OF_HOURS = {"day"}
FILES = [
    path
    for path in shipped(PLANS)
    if path.suffix == ".xml" and path.parent == PLANS and path.stem not in OF_HOURS
]
"""Not the missions and the day, which wait for answers, telemetry and hours."""


class Flight:
    def __init__(self, folder: Path) -> None:
        self.lock = LockStep(load_settings("jackal"), World(), folder)
        self.lock.run(0.2)
        self.number = 0

    def send(self, request: Request) -> None:
        self.number += 1
        command = Command(Identity("MOE", self.number), request, "direct")
        assert isinstance(self.lock.submit(command), Accepted)

    def until(self, *statuses: PlanStatus) -> PlanStatus:
        executive = self.lock.executive
        self.lock.run_until(lambda: executive.plans()[0].status in statuses, 300.0)
        return executive.plans()[0].status


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
@pytest.mark.parametrize("killed", [False, True])
def test_each_plan_is_carried_out(tmp_path: Path, file: Path, killed: bool) -> None:
    flight = Flight(tmp_path)
    flight.send(SubmitPlan(PlanDefinition(file.stem, file.name, "BTCPP4", file.read_bytes())))
    flight.send(ActivatePlan(file.stem))
    if killed:
        flight.lock.run(6.0)
        flight.lock.kill()
        flight.lock.start()
        flight.lock.run(2.0)
        assert flight.until(PlanStatus.SUSPENDED) is PlanStatus.SUSPENDED
        flight.send(ResumePlan(file.stem))
    end = flight.until(PlanStatus.COMPLETED, PlanStatus.FAILED)
    assert end is PlanStatus.COMPLETED, flight.lock.executive.plans()
