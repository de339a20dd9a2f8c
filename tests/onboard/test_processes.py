"""The executive and the simulation as users run them: two processes, ROS between them."""

import asyncio
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist

from adapters.mrs.ground.client import MrsClient
from adapters.mrs.ground.outcome import Outcome
from adapters.mrs.spec.types import AssetMode, Notification, Stage
from adapters.ros import ros_node
from executive.commands.catalogue import DriveFor, MoveForward, Request, Resume, Stop, TakePicture
from executive.reasons import Reason
from tests.support.probe import Probe, probing
from tests.support.processes import LIMIT_S, Running, executive, running, simulation

pytestmark = pytest.mark.ros

LONG_DRIVE = DriveFor(0.3, 0.0, 50.0)


@pytest.fixture(scope="module")
def probe(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Probe]:
    """Give a probe beside one simulation, for all tests of this file."""
    assert module_ros_domain
    with simulation(tmp_path_factory.mktemp("sim"), "--camera", "rays"), probing() as probe:
        yield probe


@pytest.fixture
def aboard(tmp_path: Path) -> Iterator[tuple[Running, str]]:
    with executive(tmp_path) as started:
        yield started


def carry_out(uri: str, *requests: Request) -> list[Outcome]:
    """Send requests one after the other, each when the one before has ended."""

    async def session() -> list[Outcome]:
        async with await MrsClient.connect(uri) as client:
            return [await client.run(client.command(request)) for request in requests]

    return asyncio.run(session())


def start(uri: str, request: Request) -> int:
    """Send a request and hang up; return its number."""

    async def session() -> int:
        async with await MrsClient.connect(uri) as client:
            command = client.command(request)
            await client.submit(command)
            return command.identity.command_id

    return asyncio.run(session())


def notifications(uri: str) -> tuple[Notification, ...]:
    async def session() -> tuple[Notification, ...]:
        async with await MrsClient.connect(uri) as client:
            return await client.get_notifications()

    return asyncio.run(session())


def mode(uri: str) -> AssetMode:
    async def session() -> AssetMode:
        async with await MrsClient.connect(uri) as client:
            return (await client.get_status()).mode

    return asyncio.run(session())


def has_odometry(uri: str) -> None:
    """Wait until the executive knows where the rover is."""

    async def session() -> None:
        async with await MrsClient.connect(uri) as client:
            async for value in await client.telemetry():
                if value.name == "POS_X" and value.value is not None:
                    return

    asyncio.run(asyncio.wait_for(session(), LIMIT_S))


def test_a_command_moves_the_rover_as_far_as_it_says(
    probe: Probe, aboard: tuple[Running, str]
) -> None:
    _, uri = aboard
    has_odometry(uri)
    before = probe.fresh_truth().pose.pose.position.x
    (outcome,) = carry_out(uri, MoveForward(0.5))
    assert outcome.executed
    assert probe.fresh_truth().pose.pose.position.x - before == pytest.approx(0.5, abs=0.05)


def test_a_stop_ends_a_drive_and_holds_until_resume(
    probe: Probe, aboard: tuple[Running, str]
) -> None:
    _, uri = aboard
    has_odometry(uri)
    drive = start(uri, LONG_DRIVE)
    probe.moving()
    stop, refused = carry_out(uri, Stop(), MoveForward(0.5))
    assert stop.executed
    assert refused.refusal is not None
    assert mode(uri) is AssetMode.STOPPED
    probe.standing()
    (resume,) = carry_out(uri, Resume())
    assert resume.executed
    life = [n for n in notifications(uri) if n.commandId == drive]
    assert [n.stage for n in life][-1] is Stage.CANCELLED
    assert life[-1].code == Reason.STOPPED.value


def test_a_killed_executive_leaves_a_standing_rover_and_a_successor_that_says_so(
    probe: Probe, aboard: tuple[Running, str], tmp_path: Path
) -> None:
    process, uri = aboard
    has_odometry(uri)
    drive = start(uri, LONG_DRIVE)
    probe.moving()
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.standing()
    stood = probe.fresh_truth().pose.pose.position
    with executive(tmp_path) as (_, again):
        has_odometry(again)
        life = [n for n in notifications(again) if n.commandId == drive]
        assert life[-1].stage is Stage.FAILED
        assert life[-1].code == Reason.INTERRUPTED.value
        sequences = [n.sequence for n in notifications(again)]
        assert sequences == list(range(1, len(sequences) + 1))
        stands = probe.fresh_truth().pose.pose.position
        assert (stands.x, stands.y) == pytest.approx((stood.x, stood.y), abs=0.005)


def test_sigterm_while_driving_stops_the_rover_and_exits_0(
    probe: Probe, aboard: tuple[Running, str], tmp_path: Path
) -> None:
    process, uri = aboard
    has_odometry(uri)
    drive = start(uri, LONG_DRIVE)
    probe.driven()
    probe.moving()
    process.send(signal.SIGTERM)
    process.said("asked to end")
    process.send(signal.SIGINT)  # from somebody impatient
    assert process.ended() == 0
    assert "Traceback" not in process.text
    probe.until(lambda: probe.velocities[-1].linear.x == 0.0, "a last zero")
    with executive(tmp_path) as (_, again):
        last = [n for n in notifications(again) if n.commandId == drive][-1]
        assert last.stage is Stage.CANCELLED
        assert last.code == Reason.INTERRUPTED.value


def test_a_joystick_is_noticed_and_named(probe: Probe, aboard: tuple[Running, str]) -> None:
    _, uri = aboard

    async def session() -> str:
        async with await MrsClient.connect(uri) as client:
            stream = client.notifications()
            with ros_node("joystick", "jackal") as node:
                node.create_publisher(Twist, probe.topics.cmd_vel.name, 1)
                async for notification in stream:
                    if "/jackal/joystick" in (text := notification.text or ""):
                        return text
        raise AssertionError("the stream ended")

    assert "may move the rover" in asyncio.run(asyncio.wait_for(session(), LIMIT_S))


@pytest.mark.usefixtures("probe")
def test_a_picture_is_stored(aboard: tuple[Running, str], tmp_path: Path) -> None:
    _, uri = aboard
    has_odometry(uri)
    (outcome,) = carry_out(uri, TakePicture())
    assert outcome.executed
    (picture,) = (tmp_path / "data" / "files" / "pictures").iterdir()
    assert picture.read_bytes().startswith(b"\xff\xd8\xff")


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
def test_a_second_process_on_one_ledger_is_refused(tmp_path: Path) -> None:
    with executive(tmp_path):
        arguments = ("--port", "0", "--data", str(tmp_path / "data"))
        with running(tmp_path / "second", "rover-executive", *arguments) as second:
            assert second.ended() == 1
            assert "another process" in second.text
            assert "Traceback" not in second.text
