"""The controller chosen for a command, over a rover that moves as told."""

from collections.abc import Iterator
from dataclasses import replace
from math import pi
from pathlib import Path
from types import SimpleNamespace

import pytest

from adapters.onboard import planning as onboard
from executive.commands import (
    FollowPath,
    Motion,
    MoveForward,
    MoveTo,
    ResumePlan,
    SetTravelSpeed,
    SuspendPlan,
    Waypoint,
)
from executive.commands.intake import check_arguments
from executive.commands.lifecycle import Duplicate
from executive.faults import ClearPolicy, Reaction
from executive.motion import MinimumTimeSolver, make_solver
from executive.settings import Controller, MpcSettings, Settings, load_settings
from executive.values.geometry import Point, Velocity
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, Stage
from tests.support.kinematic import STEP_S, Bench
from tests.support.plans import PlanBench, plan

pytestmark = pytest.mark.at_length

TURN_DRIVE, MPC = OWN = (Controller.TURN_DRIVE, Controller.MPC)
JACKAL = load_settings("jackal")
OFFERING = replace(
    JACKAL,
    mpc=MpcSettings(steps=10, command_delay_s=STEP_S / 2, odometry_age_s=0.0, selectable=True),
)
THERE, BACK = Waypoint(1.0, 1.0, pi / 2), Waypoint(0.0, 0.0, 0.0)
BEND = (Waypoint(1.5, 0.0), Waypoint(2.5, 1.0), Waypoint(2.5, 2.0))
LOW_V, FULL_V = 20.0, 26.0


@pytest.fixture(scope="module")
def solver() -> MinimumTimeSolver:
    return make_solver(OFFERING)


@pytest.fixture
def bench(tmp_path: Path, solver: MinimumTimeSolver) -> Iterator[PlanBench]:
    with PlanBench(tmp_path, OFFERING, solver=solver) as bench:
        yield bench


def driven(bench: Bench, since: int = 0) -> Controller:
    """Return what drove: on a curve the rover travels and turns at the same time."""
    curved = [each for each in bench.rover.sent[since:] if is_curve(each)]
    return MPC if len(curved) > 5 else TURN_DRIVE


def is_curve(velocity: Velocity) -> bool:
    return min(abs(velocity.travel_mps), abs(velocity.rotate_radps)) > 0.25


def sent_by(bench: Bench, *numbers: int) -> list[Controller]:
    """Let commands end one after the other, and return what drove in each."""
    found = []
    for number in numbers:
        since = len(bench.rover.sent)
        assert bench.finish(number) is Stage.EXECUTED
        found.append(driven(bench, since))
    return found


@pytest.mark.at_length
def test_a_queue_is_driven_by_what_each_command_chooses(bench: PlanBench) -> None:
    requested: list[tuple[Motion, Controller]] = [
        (MoveTo(THERE), TURN_DRIVE),
        (MoveTo(BACK, MPC), MPC),
        (FollowPath((THERE, BACK), TURN_DRIVE), TURN_DRIVE),
        (MoveForward(0.5), TURN_DRIVE),
        (FollowPath(BEND, MPC), MPC),
        (FollowPath((BACK, THERE)), TURN_DRIVE),
    ]
    for number, (request, _) in enumerate(requested, 1):
        bench.submit(request, number)
    assert sent_by(bench, *range(1, 7)) == [controller for _, controller in requested]


def test_a_path_is_passed_through_by_mpc_alone(bench: PlanBench) -> None:
    for number, controller in enumerate(OWN, 1):
        bench.execute(FollowPath(BEND, controller), 2 * number)
        bench.execute(MoveTo(BACK), 2 * number + 1)
    took_s = [bench.last(2 * number).figures[0].value for number in (1, 2)]
    assert took_s[1] < 0.7 * took_s[0]


def test_the_controller_of_the_command_overrides_that_of_the_asset(
    tmp_path: Path, solver: MinimumTimeSolver
) -> None:
    own = replace(OFFERING, controller=MPC, mpc=replace(OFFERING.mpc, selectable=False))
    with Bench(tmp_path, own, solver=solver) as bench:
        bench.submit(MoveTo(THERE, TURN_DRIVE), 1)
        bench.submit(MoveTo(BACK), 2)
        bench.submit(FollowPath((THERE,), MPC), 3)
        assert sent_by(bench, 1, 2, 3) == [TURN_DRIVE, MPC, MPC]


@pytest.mark.parametrize("then", [Reaction.PAUSE, Reaction.SLOW_DOWN])
@pytest.mark.parametrize("controller", OWN)
def test_it_stays_after_a_pause_and_while_slow(
    controller: Controller, then: Reaction, tmp_path: Path, solver: MinimumTimeSolver
) -> None:
    row = replace(OFFERING.faults.battery_low, reaction=then, clears=ClearPolicy.AUTO)
    settings = replace(OFFERING, faults=replace(OFFERING.faults, battery_low=row))
    with Bench(tmp_path, settings, solver=solver) as bench:
        bench.submit(MoveTo(Waypoint(0.0, 2.5, pi), controller), 1)
        bench.run(1.0)
        bench.voltage_v = LOW_V
        bench.run(1.5)
        since = len(bench.rover.sent)
        bench.voltage_v = FULL_V
        assert bench.finish(1) is Stage.EXECUTED
        assert driven(bench, since) is controller


def test_speeds_set_during_the_drive_hold_with_either(bench: PlanBench) -> None:
    for number, controller in enumerate(OWN, 1):
        bench.submit(FollowPath(BEND, controller), 10 * number)
        bench.run(1.0)
        bench.submit(SetTravelSpeed(0.3), 10 * number + 1)
        bench.run(1.0)
        since = len(bench.rover.sent)
        assert bench.finish(10 * number) is Stage.EXECUTED
        assert max(abs(each.travel_mps) for each in bench.rover.sent[since:]) <= 0.3 + 1e-9
        bench.execute(SetTravelSpeed(1.0), 10 * number + 2)
        bench.execute(MoveTo(BACK), 10 * number + 3)


def test_another_controller_is_another_command(bench: PlanBench) -> None:
    bench.execute(MoveTo(THERE, MPC), 1)
    assert isinstance(bench.submit(MoveTo(THERE, MPC), 1), Duplicate)
    for other in (MoveTo(THERE, TURN_DRIVE), MoveTo(THERE)):
        assert bench.refusal(other, 1).reason is Reason.DUPLICATE


def test_the_record_has_the_controller(bench: PlanBench) -> None:
    requested: tuple[Motion, ...] = (
        MoveTo(THERE, MPC),
        FollowPath(BEND, TURN_DRIVE),
        MoveTo(THERE),
    )
    for number, request in enumerate(requested, 1):
        bench.submit(request, number)
    bench.crash()
    stored = [bench.ledger.request(Identity("MOE", number)) for number in (1, 2, 3)]
    assert stored == list(requested)


def test_a_plan_continues_with_its_controllers_after_a_restart(bench: PlanBench) -> None:
    legs = (
        '<moveTo x="1" y="1" heading="1.57" controller="{first}"/>'
        '<followPath waypoints="0,0,0" controller="mpc"/>'
    )
    body = f'<Timeout msec="90000"><Sequence>{legs}</Sequence></Timeout>'
    bench.go(plan(body, first="turn_drive"))
    bench.run(1.0)
    bench.request(SuspendPlan("survey"))
    bench.run(1.0)
    bench.crash()
    bench.run(1.0)
    bench.request(ResumePlan("survey"))
    found = []
    for done in (1, 2):
        since = len(bench.rover.sent)
        while bench.status().done < done and bench.status().status is not PlanStatus.FAILED:
            bench.step()
        found.append(driven(bench, since))
    assert bench.until(PlanStatus.COMPLETED, PlanStatus.FAILED) is PlanStatus.COMPLETED
    assert found == [TURN_DRIVE, MPC]


MOCUP = load_settings("mocup")


@pytest.mark.parametrize(
    ("settings", "request_", "message"),
    [
        (
            JACKAL,
            MoveTo(THERE, MPC),
            "jackal does not offer it; leave it out, or set mpc.selectable",
        ),
        (JACKAL, FollowPath(BEND, MPC), "needs the extra mpc"),
        (MOCUP, MoveTo(THERE, MPC), "controller mpc: mocup drives by itself; leave it out"),
        (MOCUP, MoveTo(THERE, TURN_DRIVE), "controller turn_drive: mocup drives by itself"),
    ],
)
def test_a_controller_that_the_asset_does_not_offer_is_refused(
    settings: Settings, request_: Motion, message: str
) -> None:
    refusal = check_arguments(request_, settings, Point(0.0, 0.0))
    assert refusal is not None
    assert (refusal.reason, refusal.argument) == (Reason.NOT_SUPPORTED, 2)
    assert message in refusal.text


def test_turn_drive_can_be_chosen_anywhere_it_drives(tmp_path: Path) -> None:
    with Bench(tmp_path, JACKAL) as bench:
        bench.execute(MoveTo(THERE, TURN_DRIVE), 1)


def test_only_rovers_that_take_velocities_offer_it() -> None:
    with pytest.raises(ValueError, match=r"mpc\.selectable is true: it is for rovers whose"):
        replace(MOCUP, mpc=MpcSettings(selectable=True))


def test_a_solver_is_made_only_where_mpc_is_offered(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Settings] = []

    def make(settings: Settings) -> SimpleNamespace:
        made.append(settings)
        return SimpleNamespace()

    monkeypatch.setattr(onboard, "make_solver", make)
    with onboard.planning(JACKAL) as none, onboard.planning(OFFERING) as solver:
        assert none is None
        assert solver is not None
    assert made == [OFFERING]
