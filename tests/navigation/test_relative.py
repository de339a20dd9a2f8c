"""moveForward and rotateBy by actions of a navigation that lies."""

from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import MoveForward, RotateBy
from executive.settings import NavigationGate, RelativeActions
from executive.values.geometry import wrap_rad
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.stress.strange_navigations import StrangeNavigation
from tests.support.navigated import NavigatedBench, settings

MAX_OFF_M, MAX_OFF_RAD = 0.13, 0.1
BEHAVIOURS = (
    "honest",
    "never_ends",
    "feedback_lies",
    "drives_away_and_succeeds",
    "succeeds_off_and_turned",
)


@pytest.mark.parametrize("behaviour", BEHAVIOURS)
@pytest.mark.parametrize(
    ("request_", "gate"),
    [(MoveForward(1.0), NavigationGate.LOCK), (RotateBy(-2.0), NavigationGate.RELAY)],
)
def test_a_relative_motion_is_executed_only_where_it_ends(
    request_: MoveForward | RotateBy, behaviour: str, gate: NavigationGate, tmp_path: Path
) -> None:
    own = settings(gate)
    assert own.navigation is not None
    relative = replace(own.navigation, relative=RelativeActions.NAV2)
    chosen = replace(own, navigation=relative)
    with NavigatedBench(tmp_path, gate, StrangeNavigation(behaviour, 3), chosen) as bench:
        bench.run(1.0)
        bench.submit(request_, 1)
        stage, truth = bench.finish(1), bench.rover.truth
        ahead_m, turn_rad = (1.0, 0.0) if isinstance(request_, MoveForward) else (0.0, -2.0)
        if stage is Stage.EXECUTED:
            assert abs(truth.x_m - ahead_m) <= MAX_OFF_M
            assert abs(truth.y_m) <= MAX_OFF_M
            assert abs(wrap_rad(truth.heading_rad - turn_rad)) <= MAX_OFF_RAD
        else:
            assert behaviour not in {"honest", "never_ends"}
            assert bench.last(1).reason is Reason.OFF_TARGET
