from collections.abc import Iterator
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from py_trees.common import Status

from executive.commands import Mode, MoveForward, Resume, SetCameraAngles, SetTravelSpeed, Stop
from executive.commands.lifecycle import Accepted, Rejected
from executive.goals import Context
from executive.values.facts import Battery, Odometry
from executive.values.geometry import STANDING, Pose
from executive.values.parameters import Parameter
from executive.values.reasons import Reason
from executive.values.reports import Stage
from tests.support.kinematic import ALL_STAGES, Bench, ignoring
from trees import RoverTree
from trees.motion import Drive


def test_a_stop_sends_zero_first_and_ends_all(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.submit(SetCameraAngles(2.0, 0.0), 3)
    bench.run(2.0)
    assert bench.rover.velocity.travel_mps > 0.9
    assert isinstance(bench.submit(Stop(), 9), Accepted)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED
    assert bench.finish(9) is Stage.EXECUTED
    assert bench.stages(1)[-1] is bench.stages(2)[-1] is Stage.CANCELLED
    assert bench.last(1).reason is Reason.STOPPED
    assert "MOE:9" in bench.last(1).text


def test_nothing_moves_while_stopped_until_resumed(bench: Bench) -> None:
    bench.execute(Stop(), 1)
    assert bench.refusal(MoveForward(1.0), 2).reason is Reason.WRONG_MODE
    assert bench.stages(2) == [Stage.RECEIVED, Stage.REJECTED]
    bench.run(1.0)
    assert set(bench.rover.sent) == {STANDING}
    assert "MOE:1" in bench.executive.why
    bench.submit(Resume(), 3)
    assert bench.stages(3) == ALL_STAGES
    bench.execute(MoveForward(1.0), 4)


def test_lost_odometry_stops_the_rover_within_its_bound(bench: Bench) -> None:
    bench.drive_on(2.0)
    bench.odometry = False
    bench.run(0.35)
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.SAFE
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.ODOMETRY_STALE
    assert bench.refusal(Resume(), 2).reason is Reason.CAUSE_PERSISTS
    bench.odometry = True
    bench.run(0.1)
    assert isinstance(bench.submit(Resume(), 3), Accepted)


def test_a_jump_of_the_odometry_is_not_followed(bench: Bench) -> None:
    bench.drive_on(2.0)
    bench.rover.pose = replace(bench.rover.pose, y_m=bench.rover.pose.y_m + 0.5)
    bench.step()
    assert bench.rover.velocity == STANDING
    assert bench.last(1).reason is Reason.ODOMETRY_JUMPED
    bench.submit(Resume(), 2)
    assert bench.executive.mode is Mode.IDLE


def test_odometry_that_is_not_finite_counts_as_lost(bench: Bench) -> None:
    bench.drive_on()
    bench.odometry = False
    for _ in range(8):
        bench.step()
        bench.executive.observe(Odometry(0.0, Pose(nan, 0.0), STANDING))
    assert bench.last(1).reason is Reason.ODOMETRY_NOT_FINITE
    assert bench.rover.velocity == STANDING


def test_leaning_and_a_low_battery_make_the_rover_safe(bench: Bench) -> None:
    bench.drive_on()
    bench.rover.pose = replace(bench.rover.pose, roll_rad=0.6)
    bench.executive.observe(Odometry(0.0, bench.rover.pose, bench.rover.velocity))
    bench.executive.tick()
    assert bench.last(1).reason is Reason.TILT_LIMIT
    bench.rover.pose = replace(bench.rover.pose, roll_rad=0.0)
    bench.run(0.1)
    bench.submit(Resume(), 2)
    bench.executive.observe(Battery(20.0))
    bench.executive.tick()
    assert bench.executive.mode is Mode.SAFE
    assert bench.received.reports[-1].reason is Reason.BATTERY_LOW


class Exploding(RoverTree):
    """A rover tree whose drive leaf raises when told to."""

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self.armed = False
        (drive,) = [node for node in self.root.iterate() if isinstance(node, Drive)]
        act = drive.act

        def explode() -> Status:
            if self.armed:
                raise ZeroDivisionError("boom")
            return act()

        vars(drive)["act"] = explode


@pytest.fixture
def exploding(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path, build_tree=Exploding) as bench:
        yield bench


def test_a_leaf_that_raises_is_contained(exploding: Bench) -> None:
    bench, tree = exploding, exploding.executive.tree
    assert isinstance(tree, Exploding)
    bench.drive_on()
    tree.armed = True
    bench.step()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.LEAF_RAISED
    assert "rover/work/side by side/motion/go/leg/drive" in bench.last(1).text
    assert "boom" in bench.last(1).text
    tree.armed = False
    bench.execute(MoveForward(1.0), 2)


def test_without_a_ledger_only_a_stop_works(bench: Bench) -> None:
    bench.drive_on()
    bench.fill_disk()
    assert bench.refusal(MoveForward(1.0), 2).reason is Reason.LEDGER_FAILED
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.SAFE
    position = bench.rover.pose
    bench.submit(Stop(), 3)
    bench.run(1.0)
    assert bench.rover.pose == position
    bench.fill_disk(False)
    bench.run(0.1)
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.stages(2)[-1].terminal
    sequences = [report.sequence for report in bench.received.reports]
    assert sequences == list(range(1, len(sequences) + 1))


def test_without_a_ledger_no_camera_moves_and_nothing_gathers(bench: Bench) -> None:
    bench.fill_disk()
    pan = bench.submit(SetCameraAngles(1.0, 0.0), 1)
    bench.run(0.5)
    reports = bench.executive.last_sequence
    later = [bench.submit(SetTravelSpeed(0.3), number) for number in range(2, 20)]
    later.append(bench.submit(Resume(), 20))
    bench.run(0.5)
    assert pan == later[0] == later[-1]
    assert isinstance(pan, Rejected)
    assert pan.refusal.reason is Reason.LEDGER_FAILED
    assert bench.rover.angles.pan_rad == 0.0
    assert bench.executive.status.travel_speed_mps == bench.settings.drive.travel_speed_mps
    assert bench.executive.mode is Mode.SAFE
    assert bench.executive.last_sequence == reports
    bench.fill_disk(False)
    bench.run(0.1)
    assert bench.stages(1)[-1] is Stage.CANCELLED
    assert isinstance(bench.submit(Resume(), 21), Accepted)
    bench.execute(SetCameraAngles(1.0, 0.0), 22)


@pytest.mark.at_length
def test_a_rover_that_advances_too_slowly_fails_by_its_deadline(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Bench(tmp_path, ignoring("odometry_off_twist")) as bench:
        bench.submit(SetTravelSpeed(0.2), 2)
        bench.submit(MoveForward(1.0), 1)
        advance = bench.rover.advance
        monkeypatch.setattr(bench.rover, "advance", lambda step_s: advance(step_s * 0.32))
        assert bench.finish(1, limit_s=20.0) is Stage.FAILED
        assert bench.last(1).reason is Reason.DRIVE_DEADLINE
        bench.run(2.0)
        assert bench.rover.velocity == STANDING


def test_the_executive_is_silent_when_idle_so_that_a_joystick_may_drive(bench: Bench) -> None:
    bench.execute(MoveForward(0.5), 1)
    bench.run(1.0)
    sent = len(bench.rover.sent)
    bench.run(5.0)
    assert len(bench.rover.sent) == sent
    bench.submit(Stop(), 2)
    bench.run(1.0)
    assert len(bench.rover.sent) > sent + 15


def test_closing_halts_and_leaves_no_command_open(bench: Bench) -> None:
    bench.drive_on()
    bench.executive.close()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.CANCELLED


def test_without_a_ledger_it_ends_all_the_same(bench: Bench) -> None:
    bench.drive_on()
    bench.fill_disk()
    bench.executive.close()
    assert bench.rover.velocity == STANDING
    bench.restart()
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.INTERRUPTED


def test_a_value_of_old_odometry_is_unknown(bench: Bench) -> None:
    bench.run(0.2)
    bench.odometry = False
    bench.run(1.0)
    unknown = {value.parameter for value in bench.executive.parameters() if value.value is None}
    assert {Parameter.POS_X, Parameter.HEAD, Parameter.CURRENT_TRAVEL_SPEED} <= unknown
    assert Parameter.BATERY_VOLTAGE not in unknown


def test_safe_reports_the_end_of_its_cause(bench: Bench) -> None:
    bench.drive_on()
    bench.odometry = False
    bench.run(1.0)
    assert bench.executive.why.endswith("clear the cause, then send resume")
    bench.odometry = True
    bench.run(0.5)
    assert bench.executive.why.endswith("the cause is cleared: send resume")
