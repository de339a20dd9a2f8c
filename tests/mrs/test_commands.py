"""Every operation that carries a command, from the ground to the wheels and back."""

from dataclasses import replace
from functools import partial
from math import pi

import pytest

from adapters.mal.consumer import Consumer
from adapters.mal.errors import MalError
from adapters.mal.mal_area import NamedValue
from adapters.mal.values import AttributeType, Typed, TypedList
from adapters.mrs import types
from adapters.mrs.client import MrsClient
from adapters.mrs.core import Core
from adapters.mrs.outcome import Outcome
from adapters.mrs.types import Stage
from executive.commands import (
    Arrival,
    DriveFor,
    FollowPath,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
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
from executive.geometry import STANDING
from executive.reasons import Reason
from tests.mrs.aboard import Aboard

HEADER = types.CommandHeader(commandId=1, source="MOE", reportStarted=True, reportProgress=True)
LIFE = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


def carry_out(aboard: Aboard, *requests: Request) -> list[Outcome]:
    """Send requests one after the other, each when the one before has ended."""
    aboard.runs = True

    async def session(client: MrsClient) -> list[Outcome]:
        return [await client.run(client.command(request)) for request in requests]

    return aboard.ground(session)


def stages(outcome: Outcome) -> list[Stage | None]:
    return [notification.stage for notification in outcome.life]


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
    (outcome,) = carry_out(aboard, request_)
    assert outcome.executed
    pose = aboard.do(lambda bench: bench.rover.pose)
    assert (pose.x_m, pose.y_m) == pytest.approx((x_m, y_m), abs=0.06)
    assert abs(abs(pose.heading_rad) - abs(heading_rad)) < 0.05


def test_drives_for_a_time(aboard: Aboard) -> None:
    (outcome,) = carry_out(aboard, DriveFor(0.5, 0.0, 2.0))
    assert stages(outcome) == LIFE
    assert 0.5 < aboard.do(lambda bench: bench.rover.pose.x_m) < 1.2
    assert aboard.do(lambda bench: bench.rover.velocity) == STANDING


def test_a_path_tells_its_progress(aboard: Aboard) -> None:
    (outcome,) = carry_out(aboard, FollowPath((Waypoint(0.3, 0.0), Waypoint(0.6, 0.0))))
    steps = [(n.step, n.stepCount) for n in outcome.life if n.stage is Stage.PROGRESS]
    assert steps[0] == (1, 2)


def test_sets_speeds_and_compensation(aboard: Aboard) -> None:
    outcomes = carry_out(
        aboard,
        SetTravelSpeed(0.4),
        SetRotateSpeed(0.8),
        SetCameraRotateSpeed(0.5),
        SetPositionCompensation(1.0, 2.0, 0.5, 0.1),
        SetStatusInterval(2.5),
    )
    assert [stages(outcome) for outcome in outcomes] == [LIFE] * 5

    async def session(client: MrsClient) -> None:
        speeds = await client.get_speeds()
        assert (speeds.travelSpeed, speeds.rotateSpeed) == (0.4, 0.8)
        assert (await client.get_camera_state()).rotateSpeed == 0.5
        assert await client.get_status_interval_s() == 2.5
        pose = await client.get_pose()
        assert (pose.x, pose.y, pose.z, pose.heading) == pytest.approx((1.0, 2.0, 0.5, 0.1))

    aboard.ground(session)


def test_points_the_camera(aboard: Aboard) -> None:
    outcomes = carry_out(aboard, SetCameraAngles(0.5, None), MoveCameraAngles(0.25, -0.5))
    assert all(outcome.executed for outcome in outcomes)

    async def session(client: MrsClient) -> None:
        state = await client.get_camera_state()
        assert (state.pan, state.tilt) == pytest.approx((0.75, -0.5), abs=0.02)
        assert not state.videoOn

    aboard.ground(session)


def test_takes_a_picture(aboard: Aboard) -> None:
    (outcome,) = carry_out(aboard, TakePicture(format="JPG"))
    assert outcome.executed
    folder = aboard.do(lambda bench: bench.folder)
    number = outcome.command.identity.command_id
    assert (folder / "pictures" / f"MOE-{number}.jpg").read_bytes() == b"\xff\xd8picture"


def test_a_stop_acts_before_it_is_acknowledged(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        await client.submit(client.command(MoveForward(10.0)))
        aboard.run(3.0)
        assert aboard.do(lambda bench: bench.rover.velocity.travel_mps) > 0.5
        await client.submit(client.command(Stop()))
        assert aboard.do(lambda bench: bench.rover.velocity) == STANDING

    aboard.ground(session)


def test_stop_cancels_and_resume_lets_go_on(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        heard = client.notifications()
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
        async for notification in heard:
            ends[notification.commandId] = notification.stage
            if notification.commandId == 5 and notification.stage is Stage.EXECUTED:
                break
        assert ends == {
            1: Stage.CANCELLED,
            2: Stage.EXECUTED,
            3: Stage.REJECTED,
            4: Stage.EXECUTED,
            5: Stage.EXECUTED,
        }

    aboard.ground(session)


@pytest.mark.parametrize(
    ("request_", "number", "extra", "code"),
    [
        (MoveForward(1e6), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.OUT_OF_RANGE),
        (MoveForward(float("nan")), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.NOT_FINITE),
        (DriveFor(0.1, 0.1, 1e9), 1, TypedList(AttributeType.UINTEGER, (3,)), Reason.OUT_OF_RANGE),
        (FollowPath(()), 1, TypedList(AttributeType.UINTEGER, (1,)), Reason.EMPTY_PATH),
        (Resume(), 2, None, Reason.WRONG_MODE),
        (TakePicture(format="RAW"), 4, None, Reason.NOT_SUPPORTED),
    ],
)
def test_refuses_with_number_and_cause(
    aboard: Aboard, request_: Request, number: int, extra: object, code: Reason
) -> None:
    (outcome,) = carry_out(aboard, request_)
    assert not outcome.executed
    assert outcome.refusal is not None
    assert outcome.refusal.number == number
    assert extra is None or outcome.refusal.extra == extra
    assert stages(outcome) == [Stage.RECEIVED, Stage.REJECTED]
    assert outcome.life[-1].code == code.value
    assert outcome.life[-1].text


def test_says_busy_when_the_queue_is_full(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        room = aboard.do(lambda bench: bench.settings.drive.queue_length)
        for _ in range(room):
            await client.submit(client.command(MoveForward(1.0)))
        with pytest.raises(MalError) as raised:
            await client.submit(client.command(MoveForward(1.0)))
        assert raised.value.number == 6

    aboard.ground(session)


def test_number_nought_is_refused(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        with pytest.raises(MalError) as raised:
            await client.submit(client.command(MoveForward(1.0), command_id=0))
        assert raised.value.number == 1
        assert raised.value.extra == TypedList(AttributeType.UINTEGER, (0,))

    aboard.ground(session)


def test_a_repeat_is_not_executed_and_hears_the_last_report_again(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        command = client.command(MoveForward(0.2))
        assert (await client.run(command)).executed
        place = aboard.do(lambda bench: bench.rover.pose)
        again = await client.run(command)
        assert again.refusal is not None
        assert again.refusal.number == 3
        assert again.refusal.extra == Typed(AttributeType.LONG, command.identity.command_id)
        assert stages(again) == [Stage.EXECUTED]
        assert not again.executed
        other = await client.run(
            client.command(MoveForward(0.3), command_id=command.identity.command_id)
        )
        assert other.refusal is not None
        assert other.refusal.number == 3
        assert not other.executed
        assert aboard.do(lambda bench: bench.rover.pose) == place

    aboard.runs = True
    aboard.ground(session)


def test_what_is_too_old_is_not_begun(aboard: Aboard) -> None:
    aboard_s = aboard.do(lambda bench: bench.clock.utc_s())
    header = replace(HEADER, lifetime=2.0, creationTime=round((aboard_s - 3.0) * 1e9))

    async def session(consumer: Consumer) -> MalError:
        with pytest.raises(MalError) as raised:
            await consumer.submit("MotionControl", "moveForward", header, 1.0)
        return raised.value

    error = aboard.consume(session)
    assert error.number == 2
    assert "2 s" in error.extra.value


def test_replaces_motion_where_the_supplement_says_so(aboard: Aboard) -> None:
    async def session(client: MrsClient) -> None:
        await client.submit(client.command(MoveForward(10.0), command_id=1))
        aboard.run(1.0)
        await client.submit(client.command(MoveForward(10.0), command_id=2))
        aboard.run(1.0)
        await client.submit(client.command(MoveForward(0.1), command_id=3, arrival=Arrival.REPLACE))
        aboard.run(10.0)
        past = await client.get_notifications()
        assert {n.commandId: (n.stage, n.code) for n in past if n.commandId} == {
            1: (Stage.CANCELLED, Reason.REPLACED.value),
            2: (Stage.CANCELLED, Reason.REPLACED.value),
            3: (Stage.EXECUTED, None),
        }

    aboard.ground(session)


def test_an_unknown_arrival_never_reaches_the_core(aboard: Aboard) -> None:
    later = NamedValue(name="arrival", value=Typed(AttributeType.IDENTIFIER, "later"))

    async def session(consumer: Consumer) -> int:
        with pytest.raises(MalError) as raised:
            await consumer.submit("MotionControl", "moveForward", HEADER, 1.0, supplements=(later,))
        return raised.value.number

    assert aboard.consume(session) == 1
    assert aboard.do(lambda bench: bench.stages(1)) == []


def test_stages_that_nobody_asked_for_are_not_told(aboard: Aboard) -> None:
    header = replace(HEADER, reportStarted=False, reportProgress=False)
    path = (types.Waypoint(x=0.2, y=0.0), types.Waypoint(x=0.4, y=0.0))
    aboard.consume(lambda consumer: consumer.submit("MotionControl", "followPath", header, path))
    aboard.run(10.0)

    async def session(client: MrsClient) -> list[Stage | None]:
        return [n.stage for n in await client.get_notifications(command_id=1)]

    assert aboard.ground(session) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXECUTED]


@pytest.mark.parametrize(
    ("service", "operation", "parts"),
    [
        ("Plan", "getPlanStatus", ((),)),
        ("FileTransfer", "listFiles", (None,)),
        ("Action", "listActions", ()),
        ("MonitoringClient", "listAssets", ()),
    ],
)
def test_what_is_not_served_is_not_supported(
    aboard: Aboard, service: str, operation: str, parts: tuple[object, ...]
) -> None:
    async def session(consumer: Consumer) -> int:
        with pytest.raises(MalError) as raised:
            await consumer.request(service, operation, *parts)
        return raised.value.number

    assert aboard.consume(session) == 4


def test_a_silent_core_is_told_of(aboard: Aboard, monkeypatch: pytest.MonkeyPatch) -> None:
    aboard.hang_up()
    monkeypatch.setattr("adapters.mrs.link.Core", partial(Core, patience_s=0.05))
    aboard.listen()
    aboard.do(lambda bench: setattr(bench.executive.inbox, "wake", lambda: None))

    async def session(client: MrsClient) -> None:
        with pytest.raises(MalError, match=r"did not answer within 0\.05 s"):
            await client.get_pose()
        with pytest.raises(MalError, match="same commandId"):
            await client.submit(client.command(MoveForward(1.0)))

    aboard.ground(session)
