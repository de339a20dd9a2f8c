"""Stops, and ends of motions, of a simulated Jackal on ice, in fixed cases of `sliding_stops`."""

from typing import Final

import pytest

from executive.values.reasons import Reason
from tests.benchmarks.sliding_stops import cases, play

CASES: Final = cases(ice=360, firm=60, seed=1)
MISLED: Final = (0, 24, 48, 87, 117, 194, 228, 240, 246, 248, 261, 333)
"""In which the wheels alone tell that the rover stands, while it slides at 0.1 to 1.2 m/s."""
FIRM: Final = (361, 363, 366, 367)
"""Stops and motions without gaps of the second odometry."""


@pytest.mark.parametrize("number", MISLED)
def test_nothing_is_executed_on_ice_while_the_rover_slides(number: int) -> None:
    outcome = play(CASES[number])
    if outcome.off_m > 0.2:  # what the rover slid, its pose does not show
        assert outcome.uncertain_m >= outcome.off_m / 2
    if outcome.executed:
        assert outcome.true_mps <= 0.05
    else:
        assert outcome.reason in {
            Reason.SLIDE_AT_REST.name,
            Reason.WHEEL_SLIP.name,
            Reason.TRAVEL_SLIP.name,
        }


@pytest.mark.parametrize("number", FIRM)
def test_on_firm_ground_it_is_executed_as_soon_as_before(number: int) -> None:
    case = CASES[number]
    outcome = play(case)
    assert outcome.executed
    assert outcome.took_s < (0.8 if case.sensors == "imu" else 2.0)
