"""The watch over stopped rovers can fail: a base that goes on when it is commanded to stand."""

from unittest.mock import patch

from executive.commands import MoveForward, Stop
from executive.values.geometry import STANDING, Velocity
from tests.simulated.deeds import Link, Order, Storm
from tests.simulated.situations import CALM
from tests.simulated.storm import play
from tests.support.kinematic import KinematicRover


def test_a_rover_that_moves_while_it_is_stopped_is_found() -> None:
    orders = (Order(20.0, Link.DIRECT, 1, MoveForward(3.0)), Order(22.0, Link.DIRECT, 2, Stop()))
    storm = Storm("stop watch", CALM, orders)
    assert not play(storm, quiet_s=30.0).findings

    def drive(rover: KinematicRover, velocity: Velocity) -> None:
        if velocity != STANDING:
            rover.velocity = velocity

    with patch.object(KinematicRover, "drive", drive):
        found = {finding.what for finding in play(storm, quiet_s=30.0).findings}
    assert "a stopped rover moved" in found
