"""The robot's own emergency stop: a button on it, not a command of the ground."""

from pathlib import Path

from executive.commands import Mode, MoveTo, Resume, Waypoint
from executive.commands.lifecycle import Accepted, Rejected
from executive.values.facts import EmergencyStop
from executive.values.geometry import STANDING
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.kinematic import Bench


def test_it_makes_the_rover_safe_until_it_is_released_and_resumed(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveTo(Waypoint(5.0, 0.0)), 1)
        bench.run(2.0)
        bench.executive.observe(EmergencyStop(True))
        bench.run(1.0)
        assert bench.executive.mode is Mode.SAFE
        assert bench.rover.velocity == STANDING
        assert bench.last(1).stage is Stage.FAILED
        assert bench.last(1).reason is Reason.EMERGENCY_STOP

        refused = bench.submit(MoveTo(Waypoint(5.0, 0.0)), 2)
        assert isinstance(refused, Rejected)
        assert refused.refusal.reason is Reason.EMERGENCY_STOP
        assert "release it there, then send resume" in refused.refusal.text
        resumed = bench.submit(Resume(), 3)
        assert isinstance(resumed, Rejected)
        assert resumed.refusal.reason is Reason.CAUSE_PERSISTS

        bench.executive.observe(EmergencyStop(False))
        bench.run(2.0)
        assert bench.executive.mode is Mode.SAFE, "a release moves nothing"
        assert bench.rover.velocity == STANDING
        assert isinstance(bench.submit(Resume(), 4), Accepted)
        bench.submit(MoveTo(Waypoint(5.0, 0.0)), 5)
        bench.run(15.0)
        assert bench.last(5).stage is Stage.EXECUTED


def test_a_report_of_no_stop_changes_nothing(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
        bench.run(0.5)
        bench.executive.observe(EmergencyStop(False))
        bench.run(10.0)
        assert bench.last(1).stage is Stage.EXECUTED
