"""Preconditions of commands: judged on arrival, at the start, never for a stop."""

from dataclasses import replace
from math import hypot, nan, radians
from pathlib import Path
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.commands import (
    Command,
    ConfirmPose,
    DriveFor,
    ExecuteAction,
    Mode,
    MoveForward,
    OnlyAt,
    Precondition,
    PreemptionPolicy,
    Request,
    RotateBy,
    SetTravelSpeed,
    Stop,
    TakePicture,
)
from executive.commands.lifecycle import Accepted, Duplicate
from executive.record import Ledger, LedgerError, digest
from executive.values.geometry import Pose
from executive.values.reasons import Identity, Reason
from executive.values.reports import Stage
from tests.support.kinematic import Bench, KinematicRover
from tests.support.preconditions import PRECONDITIONS

ORIGIN = Precondition(at=OnlyAt(0.0, 0.0, 0.5))
AHEAD = Precondition(at=OnlyAt(2.0, 0.0, 0.3, 0.0, 0.2))
PICTURE = TakePicture(640, 480)


def figures(bench: Bench, number: int) -> dict[str, float]:
    return {each.name: each.value for each in bench.last(number).figures}


def test_a_motion_is_executed_where_it_is_meant_to_start(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1, precondition=ORIGIN)
        assert bench.finish(1) is Stage.EXECUTED


def test_at_another_pose_it_is_refused_with_position_distance_and_bound(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        refusal = bench.refusal(MoveForward(1.0), 1, precondition=AHEAD)
        assert refusal.reason is Reason.PRECONDITION_POSE
        assert "2.00 m away, at x 0.00 m, y 0.00 m" in refusal.text
        found = figures(bench, 1)
        assert found["distance"] == pytest.approx(2.0)
        assert (found["x"], found["bound"]) == (0.0, 0.3)
        assert bench.finish(1) is Stage.REJECTED


def test_the_heading_counts_over_the_half_turn(tmp_path: Path) -> None:
    with Bench(tmp_path, rover=KinematicRover(Pose(heading_rad=radians(175)))) as bench:
        near = Precondition(at=OnlyAt(0.0, 0.0, 0.5, radians(-175), radians(11)))
        far = Precondition(at=OnlyAt(0.0, 0.0, 0.5, radians(-170), radians(11)))
        assert "turned by 15.0°" in bench.refusal(RotateBy(0.1), 1, precondition=far).text
        assert isinstance(bench.submit(RotateBy(0.1), 2, precondition=near), Accepted)


def test_on_arrival_the_end_of_the_motions_before_it_counts(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(2.0), 1)
        assert bench.refusal(RotateBy(0.5), 2, precondition=ORIGIN).reason is (
            Reason.PRECONDITION_POSE
        )
        bench.submit(RotateBy(0.5), 3, precondition=AHEAD)
        assert bench.finish(3) is Stage.EXECUTED


def test_at_its_start_the_pose_counts_and_the_next_falls_by_its_own(tmp_path: Path) -> None:
    near, far = (Precondition(at=OnlyAt(0.07, 0.995, bound)) for bound in (0.05, 0.2))
    with Bench(tmp_path) as bench:
        bench.submit(DriveFor(0.5, 1.0, 3.0), 1)  # it ends 9 cm off its arc
        bench.submit(RotateBy(0.5), 2, precondition=near)
        bench.submit(RotateBy(0.5), 3, precondition=far)
        bench.submit(RotateBy(0.5), 4, precondition=near)
        bench.submit(MoveForward(0.2), 5)
        assert [bench.finish(each) for each in range(2, 6)] == [
            *(Stage.FAILED, Stage.EXECUTED, Stage.FAILED, Stage.EXECUTED)
        ]
        assert bench.last(2).reason is Reason.PRECONDITION_POSE
        found = figures(bench, 2)
        assert found["distance"] == pytest.approx(hypot(found["x"] - 0.07, found["y"] - 0.995))
        assert found["bound"] == 0.05 < found["distance"] < 0.2


def test_an_uncertain_pose_meets_no_narrow_bound(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.execute(ConfirmPose(0.4, 0.1), 1)
        wide = Precondition(at=OnlyAt(0.0, 0.0, 1.0))
        narrow = Precondition(at=OnlyAt(0.0, 0.0, 0.3))
        turned = Precondition(at=OnlyAt(0.0, 0.0, 1.0, 0.0, 0.05))
        assert (
            "uncertain by 0.40 m and 5.7 deg"
            in bench.refusal(RotateBy(0.5), 2, precondition=narrow).text
        )
        assert (
            "turned by 0.0°; the pose is uncertain"
            in bench.refusal(RotateBy(0.5), 3, precondition=turned).text
        )
        assert figures(bench, 2)["position uncertainty"] == pytest.approx(0.4)
        bench.submit(RotateBy(0.5), 4, precondition=wide)
        assert bench.finish(4) is Stage.EXECUTED


def test_without_odometry_no_pose_is_known(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.odometry = False
        bench.run(2.0)
        refusal = bench.refusal(PICTURE, 1, precondition=ORIGIN)
        assert refusal.reason is Reason.NO_ODOMETRY


@pytest.mark.parametrize("request_", [MoveForward(0.5), PICTURE])
def test_a_command_waits_for_the_one_that_it_must_follow(tmp_path: Path, request_: Request) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.submit(request_, 2, precondition=Precondition(after=1))
        bench.run(1.0)
        assert bench.stages(2)[-1] is Stage.ACCEPTED
        bench.finish(1)
        assert bench.finish(2) is Stage.EXECUTED


def test_after_a_command_that_failed_or_is_unknown_it_is_refused(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.refusal(MoveForward(1e6), 1)
        after_refused = bench.refusal(MoveForward(0.5), 2, precondition=Precondition(after=1))
        assert after_refused.reason is Reason.PRECONDITION_COMMAND
        assert "MOE:1, which is REJECTED" in after_refused.text
        assert after_refused.cause == Identity("MOE", 1)
        lost = bench.refusal(MoveForward(0.5), 4, precondition=Precondition(after=3))
        assert "MOE:3, which is not known aboard" in lost.text
        itself = bench.refusal(MoveForward(0.5), 5, precondition=Precondition(after=5))
        assert "not known" in itself.text
        bench.submit(MoveForward(1.0), 6)
        setting = bench.refusal(SetTravelSpeed(0.5), 7, precondition=Precondition(after=6))
        assert "MOE:6, which is" in setting.text
        replaced = bench.refusal(
            MoveForward(0.5),
            *(8,),
            preemption=PreemptionPolicy.REPLACE,
            precondition=Precondition(after=6),
        )
        assert "MOE:6, which is" in replaced.text


def test_the_end_of_another_source_does_not_count(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.execute(MoveForward(0.5), 1)
        other = Command(
            Identity("EUROPE", 2), MoveForward(0.5), "direct", precondition=Precondition(after=1)
        )
        assert "EUROPE:1, which is not known" in bench.send(other).refusal.text  # type: ignore[union-attr]


def test_if_the_one_before_fails_it_fails_at_its_start(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.rover.camera_works = False
        bench.submit(PICTURE, 1)
        bench.submit(MoveForward(0.5), 2, precondition=Precondition(after=1))
        bench.submit(MoveForward(0.5), 3, precondition=Precondition(after=1), lifetime_s=0.5)
        assert bench.finish(1) is Stage.FAILED
        assert bench.finish(2) is Stage.FAILED
        assert bench.last(2).reason is Reason.PRECONDITION_COMMAND
        assert bench.last(2).cause == Identity("MOE", 1)
        assert bench.finish(3) is Stage.EXPIRED


def test_the_reason_of_a_waiting_motion_is_named(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(PICTURE, 1)
        bench.submit(MoveForward(0.5), 2, precondition=Precondition(after=1))
        bench.step()
        assert bench.executive.why == "standing: MOE:2 moveForward waits: only after number 1"


def send(bench: Bench, source: str, number: int, request: Request, **options: object) -> None:
    command = Command(Identity(source, number), request, "direct", **options)  # type: ignore[arg-type]
    assert isinstance(bench.send(command), Accepted)


def last_stage(bench: Bench, source: str, number: int) -> Stage | None:
    report = bench.ledger.last_report(Identity(source, number))
    return None if report is None else report.stage


@pytest.mark.parametrize("request_", [PICTURE, ExecuteAction("VIDEO ON")])
def test_a_waiting_command_holds_only_later_ones_of_its_source(
    tmp_path: Path, request_: Request
) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.submit(request_, 2, precondition=Precondition(after=1))
        bench.submit(request_, 3)
        bench.submit(request_, 4, lifetime_s=0.2)
        send(bench, "EUROPE", 1, request_)
        send(bench, "EUROPE", 2, request_, precondition=Precondition(after=1))
        bench.run(0.5)
        assert [last_stage(bench, "EUROPE", each) for each in (1, 2)] == [Stage.EXECUTED] * 2
        assert [bench.stages(each)[-1] for each in (2, 3)] == [Stage.ACCEPTED] * 2
        assert bench.stages(4)[-1] is Stage.EXPIRED
        assert [bench.finish(each) for each in (1, 2, 3)] == [Stage.EXECUTED] * 3


def test_a_motion_waits_behind_a_waiting_one_of_another_source(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.rover.camera_works = False
        bench.submit(PICTURE, 1)
        bench.submit(MoveForward(0.5), 2, precondition=Precondition(after=1))
        send(bench, "EUROPE", 1, MoveForward(0.5))
        bench.run(0.5)
        assert last_stage(bench, "EUROPE", 1) is Stage.ACCEPTED  # it starts at the end of MOE:2


@pytest.mark.parametrize("end", ["stop", "crash"])
def test_a_waiting_command_ends_with_a_stop_or_the_process(tmp_path: Path, end: str) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.submit(PICTURE, 2, precondition=Precondition(after=1))
        bench.run(0.5)
        if end == "stop":
            bench.execute(Stop(), 3)
        else:
            bench.crash()
            bench.run(1.0)
        assert bench.stages(2)[-1] is Stage.CANCELLED
        refusal = bench.refusal(PICTURE, 4, precondition=Precondition(after=2))
        assert "MOE:2, which is CANCELLED" in refusal.text


def test_it_fails_if_the_one_before_is_replaced(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.submit(PICTURE, 2, precondition=Precondition(after=1))
        bench.replace(MoveForward(0.2), 3)
        assert bench.finish(2) is Stage.FAILED
        assert "MOE:1, which is CANCELLED" in bench.last(2).text
        assert bench.finish(3) is Stage.EXECUTED


def test_it_waits_until_the_ledger_can_be_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.submit(PICTURE, 2, precondition=Precondition(after=1))
        with monkeypatch.context() as broken:
            broken.setattr(Ledger, "last_report", Mock(side_effect=LedgerError("disk")))
            bench.run(3.0)
        assert bench.finish(1) is Stage.EXECUTED
        assert bench.finish(2) is Stage.EXECUTED


def test_the_ledger_knows_the_one_before_after_a_restart(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.execute(MoveForward(0.5), 1)
        bench.crash()
        bench.run(1.0)
        bench.submit(MoveForward(0.5), 2, precondition=Precondition(after=1))
        assert bench.finish(2) is Stage.EXECUTED


def test_the_mode_counts_without_the_motion_of_the_command_itself(tmp_path: Path) -> None:
    idle, moving = Precondition(mode=Mode.IDLE), Precondition(mode=Mode.MOVING)
    with Bench(tmp_path) as bench:
        refusal = bench.refusal(MoveForward(0.5), 1, precondition=moving)
        assert refusal.reason is Reason.PRECONDITION_MODE
        assert "only in mode MOVING, but the mode is IDLE" in refusal.text
        bench.submit(MoveForward(0.5), 2, precondition=idle)
        assert bench.refusal(MoveForward(0.5), 3, precondition=idle).reason is (
            Reason.PRECONDITION_MODE
        )
        bench.submit(MoveForward(0.5), 4, precondition=moving)
        assert bench.finish(2) is Stage.EXECUTED
        assert bench.finish(4) is Stage.EXECUTED
        picture = bench.refusal(PICTURE, 5, precondition=moving)
        assert picture.reason is Reason.PRECONDITION_MODE


@given(PRECONDITIONS)
def test_a_stop_never_has_one(only: Precondition) -> None:
    stop = Command(Identity("MOE", 1), Stop(), "direct")
    assert digest(stop) == digest(replace(stop, precondition=only))


def test_a_stop_with_one_stops(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.drive_on()
        bench.submit(Stop(), 2, precondition=Precondition(OnlyAt(9, 9, 0.1), 77, Mode.SAFE))
        assert bench.finish(2) is Stage.EXECUTED
        assert isinstance(bench.submit(Stop(), 2), Duplicate)


def test_a_repeat_with_another_precondition_is_another_command(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        bench.submit(MoveForward(0.5), 1, precondition=ORIGIN)
        same = Precondition(at=OnlyAt(0, 0, 0.5))  # as read from a link, or typed in Python
        assert isinstance(bench.submit(MoveForward(0.5), 1, precondition=same), Duplicate)
        for only in (None, Precondition(at=OnlyAt(0.0, 0.0, 0.6)), Precondition(mode=Mode.IDLE)):
            assert bench.refusal(MoveForward(0.5), 1, precondition=only).reason is Reason.DUPLICATE


@given(PRECONDITIONS)
def test_its_values_on_a_link_are_read_back(only: Precondition) -> None:
    assert Precondition.from_wire(*only.wire_values) == (only or None)


@given(st.text(max_size=40) | st.from_regex(r"\A[-0-9. e_+]{1,40}\Z"))
def test_bounds_of_a_pose_are_written_as_read(text: str) -> None:
    try:
        found = OnlyAt.parse(text)
    except ValueError:
        return
    assert OnlyAt.parse(found.wire_text) == found


@pytest.mark.parametrize(
    "text",
    ["", "1 2", "1 2 0", "1 2 -3", "1 2 3 4", "1 2 3 4 0", "1 2 3 4 9", "nan 1 1", "1e999 1 1",
     "1  2 3", "1 2 3 4 5 6", "1_0 2 3", "1,2,3"],
)  # fmt: skip
def test_a_text_without_bounds_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        OnlyAt.parse(text)


def test_typed_bounds() -> None:
    assert OnlyAt.read("3,2,50cm,90deg,10deg") == OnlyAt(3, 2, 0.5, radians(90), radians(10))
    assert str(OnlyAt.read("3,2,0.5,90deg,10deg")) == (
        "at x 3.00 m, y 2.00 m within 0.5 m, 90.0° within 10.0°"
    )
    for wrong in ("3,2", "3,2,0.5,90,10deg", "3,2,0.5,90deg", "3,2,0"):
        with pytest.raises(ValueError, match=r"."):
            OnlyAt.read(wrong)
    with pytest.raises(ValueError, match="not finite"):
        OnlyAt(nan, 0.0, 1.0)
    with pytest.raises(ValueError, match="from 1"):
        Precondition(after=0)
    with pytest.raises(TypeError, match="integer"):
        Precondition(after=3.5)  # type: ignore[arg-type]
    text = str(Precondition(OnlyAt(3, 2, 0.5), 17, Mode.IDLE))
    assert text.endswith("within 0.5 m, only after number 17, only in mode IDLE")
