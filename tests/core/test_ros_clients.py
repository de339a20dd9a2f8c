"""Commands of ROS clients in simulated time: when accepted, replaced, canceled, and by whom."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.recording import RunFile
from adapters.recording.replay import replay
from executive.commands import (
    ROS_LINK,
    ROS_SOURCE,
    ActivatePlan,
    Command,
    ConfirmPose,
    Mode,
    MoveForward,
    MoveTo,
    PreemptionPolicy,
    Request,
    Resume,
    RotateBy,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    Waypoint,
)
from executive.commands.lifecycle import Accepted, Duplicate, Rejected, SubmitResult
from executive.core.authority import HOLD_LEASE_S, AuthorityState
from executive.core.recording import RecordingSink
from executive.core.ros_clients import CancelRequest
from executive.settings import AuthoritySettings, RosCommands, RosSettings, load_settings
from executive.values.reasons import Reason
from executive.values.reports import Identity, Report, Stage
from tests.support.kinematic import Bench
from tests.support.plans import AHEAD, plan
from tests.support.requested_authority import RequestedAuthority


@contextmanager
def bench_of(
    folder: Path,
    commands: RosCommands,
    *,
    needed: bool = False,
    tape: RecordingSink | None = None,
) -> Iterator[Bench]:
    authority = AuthoritySettings(needed=needed, takeover_sources=("CHIEF",))
    settings = replace(load_settings("jackal"), ros=RosSettings(commands), authority=authority)
    with Bench(folder, settings, tape=tape) as bench:
        yield bench


def ros(bench: Bench, request: Request, number: int, *, replaces: bool = False) -> SubmitResult:
    preemption = PreemptionPolicy.REPLACE if replaces else PreemptionPolicy.APPEND
    identity = Identity(ROS_SOURCE, number)
    return bench.send(Command(identity, request, ROS_LINK, preemption=preemption))


def cancel(bench: Bench, number: int) -> None:
    request = CancelRequest(Identity(ROS_SOURCE, number), "canceled by its client")
    bench.executive.query(lambda: bench.executive.cancel(request))
    bench.executive.serve_inbox()


def last(bench: Bench, number: int) -> Report:
    identity = Identity(ROS_SOURCE, number)
    return [each for each in bench.received.reports if each.identity == identity and each.stage][-1]


def refused(answer: SubmitResult) -> Reason:
    assert isinstance(answer, Rejected), answer
    return answer.refusal.reason


def holder(bench: Bench) -> str | None:
    return bench.executive.authority.state.holder


def finish(bench: Bench, number: int) -> Stage | None:
    for _ in range(1000):
        if (stage := last(bench, number).stage) is not None and stage.terminal:
            break
        bench.step()
    return last(bench, number).stage


def test_a_stop_is_open_and_all_else_is_refused_while_off(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.OFF) as bench:
        assert refused(ros(bench, MoveForward(1.0), 1)) is Reason.NOT_SUPPORTED
        assert refused(ros(bench, SetTravelSpeed(0.2), 2)) is Reason.NOT_SUPPORTED
        bench.drive_on()
        assert isinstance(ros(bench, Stop(), 3), Accepted)
        bench.run(0.5)
        assert bench.executive.mode is Mode.STOPPED
        assert refused(ros(bench, Resume(), 4)) is Reason.NOT_SUPPORTED


@pytest.mark.parametrize("commands", [RosCommands.WHEN_FREE, RosCommands.ALWAYS])
def test_a_new_goal_replaces_the_one_before_and_both_end_once(
    tmp_path: Path, commands: RosCommands
) -> None:
    with bench_of(tmp_path, commands) as bench:
        ros(bench, MoveTo(Waypoint(3.0, 0.0)), 1, replaces=True)
        bench.run(1.0)
        ros(bench, MoveTo(Waypoint(0.5, 0.5)), 2, replaces=True)
        assert finish(bench, 2) is Stage.EXECUTED
        assert (last(bench, 1).stage, last(bench, 1).reason) == (Stage.CANCELLED, Reason.REPLACED)
        assert bench.rover.pose.x_m == pytest.approx(0.5, abs=0.05)
        assert isinstance(ros(bench, MoveTo(Waypoint(0.5, 0.5)), 2), Duplicate)


def test_a_goal_of_ros_waits_for_an_operator_or_is_refused(tmp_path: Path) -> None:
    with bench_of(tmp_path / "always", RosCommands.ALWAYS) as bench:
        bench.submit(MoveForward(1.0), 1)
        bench.run(0.5)
        assert isinstance(ros(bench, RotateBy(0.5), 7, replaces=True), Accepted)
        assert finish(bench, 7) is Stage.EXECUTED
        assert bench.stages(1)[-1] is Stage.EXECUTED
        assert bench.rover.pose.x_m == pytest.approx(1.0, abs=0.05)
    with bench_of(tmp_path / "free", RosCommands.WHEN_FREE) as bench:
        bench.submit(MoveForward(1.0), 1)
        assert refused(ros(bench, RotateBy(0.5), 7, replaces=True)) is Reason.OPERATOR_ACTIVE
        assert bench.finish(1) is Stage.EXECUTED
        assert isinstance(ros(bench, RotateBy(0.5), 8, replaces=True), Accepted)


def test_a_plan_of_an_operator_is_not_disturbed_when_ros_waits_for_a_free_rover(
    tmp_path: Path,
) -> None:
    with bench_of(tmp_path, RosCommands.WHEN_FREE) as bench:
        bench.submit(SubmitPlan(plan(AHEAD)), 1)
        bench.submit(ActivatePlan("survey"), 2)
        answer = ros(bench, SetTravelSpeed(0.2), 6)  # before its first step
        assert isinstance(answer, Rejected)
        assert "plan survey" in answer.refusal.text
        bench.run(0.5)
        assert bench.executive.mode is Mode.PLAN
        assert refused(ros(bench, SetTravelSpeed(0.2), 7)) is Reason.OPERATOR_ACTIVE


def test_a_holder_of_the_authority_is_an_operator_though_none_is_needed(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.WHEN_FREE) as bench:
        operator = RequestedAuthority(bench).request("MOE")
        assert isinstance(operator, AuthorityState)
        assert refused(ros(bench, MoveForward(1.0), 1)) is Reason.OPERATOR_ACTIVE
        RequestedAuthority(bench).release("MOE", operator.epoch)
        assert isinstance(ros(bench, MoveForward(1.0), 2), Accepted)


def test_only_an_operator_resumes_after_a_stop_of_an_operator(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.WHEN_FREE) as bench:
        ros(bench, Stop(), 1)
        bench.run(0.5)
        assert isinstance(ros(bench, Resume(), 2), Accepted)
        bench.submit(Stop(), 3)
        bench.run(0.5)
        ros(bench, Stop(), 4)  # does not hide the operator's
        bench.run(0.5)
        assert refused(ros(bench, Resume(), 5)) is Reason.OPERATOR_ACTIVE
        assert refused(ros(bench, ConfirmPose(0.0, 0.0), 6)) is Reason.OPERATOR_ACTIVE
        assert isinstance(bench.submit(Resume(), 7), Accepted)


def test_a_cancel_ends_one_command_and_leaves_no_stop(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.ALWAYS) as bench:
        ros(bench, MoveForward(3.0), 1)
        ros(bench, RotateBy(0.5), 2)
        bench.run(1.0)
        cancel(bench, 1)
        assert last(bench, 1).stage is Stage.CANCELLED
        assert last(bench, 1).reason is Reason.CANCELLED_BY_CLIENT
        cancel(bench, 1)  # again: without effect
        bench.submit(MoveForward(0.2), 3)
        cancel(bench, 3)  # of another source
        assert finish(bench, 2) is Stage.EXECUTED
        assert bench.finish(3) is Stage.EXECUTED
        assert bench.rover.pose.x_m < 1.5


def test_the_authority_is_requested_when_free_and_never_taken(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.ALWAYS, needed=True) as bench:
        authority = RequestedAuthority(bench)
        operator = authority.request("MOE")
        assert isinstance(operator, AuthorityState)
        assert refused(ros(bench, MoveForward(1.0), 1)) is Reason.NO_AUTHORITY
        assert holder(bench) == "MOE"
        authority.release("MOE", operator.epoch)
        assert refused(ros(bench, MoveForward(1000.0), 2)) is Reason.OUT_OF_RANGE
        assert holder(bench) is None  # a refused command gets none
        ros(bench, MoveForward(5.0), 3)
        bench.run(HOLD_LEASE_S + 2.0)
        assert holder(bench) == ROS_SOURCE
        assert finish(bench, 3) is Stage.EXECUTED
        authority.request("MOE")  # refused, but nothing new of ROS begins
        assert refused(ros(bench, MoveForward(0.1), 4)) is Reason.NO_AUTHORITY
        bench.run(HOLD_LEASE_S + 0.1)
        assert holder(bench) is None
        assert isinstance(authority.request("MOE"), AuthorityState)


def test_goals_end_when_the_authority_is_taken_from_ros(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.ALWAYS, needed=True) as bench:
        ros(bench, MoveForward(5.0), 1)
        ros(bench, MoveForward(5.0), 2)
        bench.run(1.0)
        assert isinstance(RequestedAuthority(bench).take("CHIEF"), AuthorityState)
        bench.run(0.1)
        for number in (1, 2):
            assert last(bench, number).stage is Stage.CANCELLED
            assert last(bench, number).reason is Reason.NO_AUTHORITY
        bench.run(1.0)
        assert bench.rover.velocity.travel_mps == 0.0


def test_a_killed_executive_moves_nothing_twice(tmp_path: Path) -> None:
    with bench_of(tmp_path, RosCommands.WHEN_FREE) as bench:
        ros(bench, MoveForward(3.0), 1)
        bench.run(1.0)
        bench.crash()
        bench.run(1.0)
        before = bench.rover.pose
        answer = ros(bench, MoveForward(3.0), 1)
        assert isinstance(answer, Duplicate)
        assert (answer.last_report.stage, answer.last_report.reason) == (
            Stage.FAILED,
            Reason.INTERRUPTED,
        )
        bench.run(1.0)
        assert bench.rover.pose == before
        assert refused(ros(bench, MoveForward(2.0), 1)) is Reason.DUPLICATE


def test_cancel_and_authority_are_replayed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with (
        closing(RunFile(path)) as tape,
        bench_of(tmp_path, RosCommands.WHEN_FREE, needed=True, tape=tape) as bench,
    ):
        ros(bench, MoveForward(3.0), 1)
        bench.run(1.0)
        ros(bench, MoveForward(1.0), 2, replaces=True)
        bench.run(1.0)
        cancel(bench, 2)
        bench.run(HOLD_LEASE_S + 1.0)
        bench.executive.close()
    assert replay(path).difference is None
