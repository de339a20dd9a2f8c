"""Every operation that carries a command, from the ground to the wheels and back."""

from dataclasses import replace
from math import pi

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import Stage, types
from executive.commands import (
    DriveFor,
    FollowPath,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
    OnlyAt,
    Precondition,
    PreemptionPolicy,
    Request,
    Resume,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    TakePicture,
    Waypoint,
)
from executive.values.geometry import STANDING
from executive.values.reasons import Reason
from tests.mrs.aboard import HEADER, Aboard, number_of, stages
from tests.support.kinematic import PICTURE

STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


@pytest.mark.parametrize(
    ("request_", "x_m", "y_m", "heading_rad"),
    [
        (MoveTo(Waypoint(1.0, 1.0, pi / 2)), 1.0, 1.0, pi / 2),
        (MoveForward(-0.5), -0.5, 0.0, 0.0),
        (RotateTo(-pi / 2), 0.0, 0.0, -pi / 2),
        (RotateBy(pi / 3), 0.0, 0.0, pi / 3),
        (FollowPath((Waypoint(0.5, 0.0), Waypoint(0.5, 0.5, pi))), 0.5, 0.5, pi),
    ],
)
def test_moves(
    aboard: Aboard, request_: Request, x_m: float, y_m: float, heading_rad: float
) -> None:
    (outcome,) = aboard.carry_out(request_)
    assert outcome.executed
    pose = aboard.do(lambda bench: bench.rover.pose)
    assert (pose.x_m, pose.y_m) == pytest.approx((x_m, y_m), abs=0.06)
    assert abs(abs(pose.heading_rad) - abs(heading_rad)) < 0.05


def test_drives_for_a_time(aboard: Aboard) -> None:
    (outcome,) = aboard.carry_out(DriveFor(0.5, 0.0, 2.0))
    assert stages(outcome) == STAGES
    assert 0.5 < aboard.do(lambda bench: bench.rover.pose.x_m) < 1.2
    assert aboard.do(lambda bench: bench.rover.velocity) == STANDING


def test_a_path_reports_its_progress(aboard: Aboard) -> None:
    (outcome,) = aboard.carry_out(FollowPath((Waypoint(0.3, 0.0), Waypoint(0.6, 0.0))))
    steps = [(n.step, n.step_count) for n in outcome.reports if n.stage is Stage.PROGRESS]
    assert steps[0] == (1, 2)


async def test_sets_speeds_and_compensation(aboard: Aboard, client: MrsClient) -> None:
    aboard.runs = True
    for setting in (
        SetTravelSpeed(0.4),
        SetRotateSpeed(0.8),
        SetCameraRotateSpeed(0.5),
        SetPositionCompensation(1.0, 2.0, 0.5, 0.1),
        SetStatusInterval(2.5),
    ):
        assert stages(await client.run(client.command(setting))) == STAGES
    speeds = await client.get_speeds()
    assert (speeds.travelSpeed, speeds.rotateSpeed) == (0.4, 0.8)
    assert (await client.get_camera_state()).rotateSpeed == 0.5
    assert await client.get_status_interval_s() == 2.5
    pose = await client.get_pose()
    assert (pose.x, pose.y, pose.z, pose.heading) == pytest.approx((1.0, 2.0, 0.5, 0.1))


async def test_points_the_camera(aboard: Aboard, client: MrsClient) -> None:
    aboard.runs = True
    for request in (SetCameraAngles(0.5, None), MoveCameraAngles(0.25, -0.5)):
        assert (await client.run(client.command(request))).executed
    state = await client.get_camera_state()
    assert (state.pan, state.tilt) == pytest.approx((0.75, -0.5), abs=0.02)
    assert not state.videoOn


def test_takes_a_picture(aboard: Aboard) -> None:
    (outcome,) = aboard.carry_out(TakePicture(format="JPG"))
    assert outcome.executed
    folder = aboard.do(lambda bench: bench.folder)
    number = outcome.command.identity.command_id
    assert (folder / "files/pictures" / f"MOE-{number}.jpg").read_bytes() == PICTURE


async def test_a_stop_acts_before_it_is_acknowledged(aboard: Aboard, client: MrsClient) -> None:
    await client.submit(client.command(MoveForward(10.0)))
    aboard.run(3.0)
    assert aboard.do(lambda bench: bench.rover.velocity.travel_mps) > 0.5
    await client.submit(client.command(Stop()))
    assert aboard.do(lambda bench: bench.rover.velocity) == STANDING


async def test_stop_cancels_and_resume_permits_motion(aboard: Aboard, client: MrsClient) -> None:
    arrived = client.notifications()
    await client.submit(client.command(MoveForward(10.0), command_id=1))
    aboard.run(1.0)
    await client.submit(client.command(Stop(), command_id=2))
    aboard.run(1.0)
    refused = await client.run(client.command(MoveForward(1.0), command_id=3))
    assert refused.refusal is not None
    assert refused.refusal.number == 2
    assert "resume" in refused.refusal.extra.value
    assert (await client.run(client.command(Resume(), command_id=4))).executed
    await client.submit(client.command(MoveForward(0.2), command_id=5))
    aboard.run(5.0)
    ends: dict[int | None, Stage | None] = {}
    async for received in arrived:
        stage = ends[number_of(received)] = received.report.stage
        if number_of(received) == 5 and stage is Stage.EXECUTED:
            break
    assert ends == {
        1: Stage.CANCELLED,
        2: Stage.EXECUTED,
        3: Stage.REJECTED,
        4: Stage.EXECUTED,
        5: Stage.EXECUTED,
    }


async def test_replaces_motion_if_the_supplement_requests_it(
    aboard: Aboard, client: MrsClient
) -> None:
    await client.submit(client.command(MoveForward(10.0), command_id=1))
    aboard.run(1.0)
    await client.submit(client.command(MoveForward(10.0), command_id=2))
    aboard.run(1.0)
    await client.submit(
        client.command(MoveForward(0.1), command_id=3, preemption=PreemptionPolicy.REPLACE)
    )
    aboard.run(10.0)
    past = await client.get_notifications()
    ends = {number_of(n): (n.report.stage, n.report.reason) for n in past if number_of(n)}
    assert ends == {
        1: (Stage.CANCELLED, Reason.REPLACED),
        2: (Stage.CANCELLED, Reason.REPLACED),
        3: (Stage.EXECUTED, None),
    }


async def test_a_lost_command_takes_the_relative_one_after_it_along(client: MrsClient) -> None:
    assert await client.supports_preconditions()
    client.command(MoveForward(1.0), command_id=1)  # which is lost
    at = Precondition(at=OnlyAt(1.0, 0.0, 0.3))
    outcome = await client.run(client.command(RotateBy(1.0), command_id=2, precondition=at))
    assert outcome.refusal is not None
    assert "but 1.00 m away" in outcome.refusal.extra.value
    after = client.command(RotateBy(1.0), command_id=3, precondition=Precondition(after=1))
    outcome = await client.run(after)
    assert outcome.refusal is not None
    assert "MOE:1, which is not known aboard" in outcome.refusal.extra.value


def test_unrequested_stages_are_not_reported(aboard: Aboard) -> None:
    header = replace(HEADER, reportStarted=False, reportProgress=False)
    path = (types.Waypoint(x=0.2, y=0.0), types.Waypoint(x=0.4, y=0.0))
    parts = (header, path, None)
    aboard.consume(lambda consumer: consumer.submit("MotionControl", "followPath", *parts))
    aboard.run(10.0)

    async def session(client: MrsClient) -> list[Stage | None]:
        return [n.report.stage for n in await client.get_notifications(command_id=1)]

    assert aboard.ground(session) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED]
