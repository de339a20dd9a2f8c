"""The executive and the simulation as users run them: two processes, ROS between them."""

import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import TwistStamped

from adapters.mal import MalUri
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec.types import PlanStatus, Severity, Stage
from adapters.recording import RunReader
from adapters.recording.replay import replay
from adapters.ros import ros_node, steady_timer
from adapters.ros.context import SpunNode
from executive.commands.catalogue import (
    ActivatePlan,
    DriveFor,
    MoveForward,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    Stop,
    SubmitPlan,
)
from executive.core.recording import CoreCalled, SimulationStarted, SimulationState
from executive.settings import config_folder
from executive.values.reasons import Reason
from executive.values.reports import Report
from sim.rover.simulation import Simulation
from tests.benchmarks.octets import Octets
from tests.support.ground import call_ground, carry_out, located, until_located
from tests.support.plans import plan
from tests.support.probe import Probe, probing
from tests.support.processes import Running, executive, running, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow]

LONG_DRIVE = DriveFor(0.3, 0.0, 50.0)
STALL_S = 0.45


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


def start(uri: str, request: Request) -> int:
    """Send a request and hang up; return its number."""

    async def submit(client: MrsClient) -> int:
        command = client.command(request)
        await client.submit(command)
        return command.identity.command_id

    return call_ground(uri, submit)


def reported(uri: str) -> list[Report]:
    return [each.report for each in call_ground(uri, lambda client: client.get_notifications())]


def number_of(report: Report) -> int | None:
    return None if report.identity is None else report.identity.command_id


def test_a_killed_executive_leaves_a_stationary_rover_and_a_successor_that_reports_it(
    probe: Probe, aboard: tuple[Running, str], tmp_path: Path
) -> None:
    process, uri = aboard
    until_located(uri)
    drive = start(uri, LONG_DRIVE)
    probe.advanced(0.75)
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.standing()
    stop_position = probe.fresh_truth().pose.pose.position
    with executive(tmp_path) as (successor, again):
        until_located(again)
        lifecycle = [n for n in reported(again) if number_of(n) == drive]
        assert lifecycle[-1].stage is Stage.FAILED
        assert lifecycle[-1].reason is Reason.INTERRUPTED
        sequences = [n.sequence for n in reported(again)]
        assert sequences == list(range(1, len(sequences) + 1))
        final_position = probe.fresh_truth().pose.pose.position
        assert (final_position.x, final_position.y) == pytest.approx(
            (stop_position.x, stop_position.y), abs=0.005
        )
        carry_out(again, MoveForward(0.3))
        assert successor.end(signal.SIGTERM) == 0
    recordings = sorted((tmp_path / "data/recordings").iterdir())
    assert [worlds_of(path) for path in recordings] == [["flat"], ["flat"]], "the simulation's own"
    killed, ended = (replay(path) for path in recordings)
    assert (killed.difference, ended.difference) == (None, None), "both decide as they did"
    assert (killed.whole, ended.whole) == (False, True)
    assert killed.decisions > 5, "what was done before the kill is there, but for its last second"


def worlds_of(recording: Path) -> list[str]:
    """Return the recorded worlds; the state of the simulation is recorded, too."""
    reader = RunReader(recording)
    kinds = [SimulationStarted, SimulationState]
    calls = [reader.decoded(message) for message in reader.messages([CoreCalled])]
    items = [reader.decoded(message) for message in reader.messages(kinds)]
    assert {type(each) for each in items} == set(kinds)
    assert all(calls[0].now_s <= each.time_s <= calls[-1].now_s + 0.1 for each in items)
    started = (each for each in items if isinstance(each, SimulationStarted))
    return [Simulation.of(each).world.name for each in started]


def test_a_stall_of_the_executive_is_no_fault(probe: Probe, aboard: tuple[Running, str]) -> None:
    process, uri = aboard
    until_located(uri)
    turns = [RotateBy(angle_rad) for angle_rad in (1.2, -1.2)]
    with ThreadPoolExecutor(1) as pool:
        outcomes = pool.submit(carry_out, uri, *turns, MoveForward(0.8))
        while not outcomes.done():
            time.sleep(1.2 - STALL_S)
            process.send(signal.SIGSTOP)
            time.sleep(STALL_S)
            process.send(signal.SIGCONT)
    ends = [outcome.reports[-1] for outcome in outcomes.result()]
    assert [(end.stage, end.text) for end in ends if end.stage is not Stage.EXECUTED] == []
    probe.standing()


def test_sigterm_while_driving_stops_the_rover_and_exits_0(
    probe: Probe, aboard: tuple[Running, str], tmp_path: Path
) -> None:
    process, uri = aboard
    until_located(uri)
    drive = start(uri, LONG_DRIVE)
    probe.driven()
    probe.moving()
    process.send(signal.SIGTERM)
    process.output("termination requested")
    process.send(signal.SIGINT)  # from somebody impatient
    assert process.ended() == 0
    assert "Traceback" not in process.text
    probe.until(lambda: probe.velocities[-1].twist.linear.x == 0.0, "a last zero")
    with executive(tmp_path) as (_, again):
        last = [n for n in reported(again) if number_of(n) == drive][-1]
        assert last.stage is Stage.CANCELLED
        assert last.reason is Reason.INTERRUPTED


def test_a_joystick_is_noticed_and_named(probe: Probe, aboard: tuple[Running, str]) -> None:
    _, uri = aboard

    async def listen(client: MrsClient) -> str:
        stream = client.notifications()
        with ros_node("joystick", "jackal") as node:
            node.create_publisher(TwistStamped, probe.topics.cmd_vel.name, 1)
            async for received in stream:
                if "/jackal/joystick" in (text := received.report.text):
                    return text
        raise AssertionError("the stream ended")

    assert "other velocity publishers" in call_ground(uri, listen)


@pytest.fixture
def joystick(probe: Probe) -> Iterator[None]:
    """Have somebody drive backward at 50 Hz, on an input of the mux above the executive's."""
    spun = SpunNode("joystick", probe.node)
    publisher = spun.node.create_publisher(TwistStamped, "joy_teleop/cmd_vel", 1)
    backward = TwistStamped()
    backward.twist.linear.x = -0.4
    steady_timer(spun.node, 0.02, lambda: publisher.publish(backward))
    yield
    spun.close()


@pytest.mark.usefixtures("joystick")
def test_killed_as_soon_as_it_is_up_it_leaves_a_standing_rover(
    probe: Probe, aboard: tuple[Running, str]
) -> None:
    process, _ = aboard
    probe.moving()
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.standing()


def test_a_guard_that_dies_is_reported_shown_and_replaced(
    probe: Probe, aboard: tuple[Running, str]
) -> None:
    process, uri = aboard
    rows: list[tuple[bytes, str]] = []

    def receive(message: DiagnosticArray) -> None:
        rows.extend((s.level, s.message) for s in message.status if s.name.endswith(": guard"))

    probe.node.create_subscription(DiagnosticArray, "/diagnostics", receive, 10)
    probe.until(lambda: (DiagnosticStatus.OK, "the guard runs") in rows, "a row of the guard")
    (supervisor,) = psutil.Process(process.pid).children()
    (guard,) = supervisor.children()
    guard.kill()
    died = "the guard was killed by signal 9 and restarted"
    probe.until(lambda: (DiagnosticStatus.WARN, died) in rows, "it is shown")
    assert died in process.text
    events: list[Report] = []

    def committed() -> bool:
        events[:] = [each for each in reported(uri) if each.text == died]
        return bool(events)

    probe.until(committed, "its report")
    assert [each.severity for each in events] == [Severity.ALARM]
    probe.until(lambda: supervisor.children() not in ([], [guard]), "another one")
    until_located(uri)
    start(uri, LONG_DRIVE)
    probe.moving()
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.until(lambda: "zero was published instead\n" in process.text, "the other one has acted")
    probe.standing()


def test_the_end_of_the_supervisor_of_the_guard_is_reported(
    probe: Probe, aboard: tuple[Running, str]
) -> None:
    process, uri = aboard
    (supervisor,) = psutil.Process(process.pid).children()
    supervisor.kill()
    process.output("the supervisor of the guard ended")
    text = "supervisor of the guard"
    probe.until(lambda: any(text in each.text for each in reported(uri)), "its report")
    assert process.end(signal.SIGTERM) == 0


@pytest.mark.usefixtures("joystick")
def test_after_a_stop_it_is_stationary_despite_another_publisher_even_if_killed(
    probe: Probe, aboard: tuple[Running, str], tmp_path: Path
) -> None:
    process, uri = aboard

    def final_position() -> None:
        probe.standing()
        x_m = probe.fresh_truth().pose.pose.position.x
        probe.until(lambda: len(probe.truth) > 50, "a second of true poses")
        assert probe.truth[-1].pose.pose.position.x == pytest.approx(x_m, abs=0.005)

    probe.moving()
    (stopped,) = carry_out(uri, Stop())
    assert stopped.executed
    final_position()
    (resumed,) = carry_out(uri, Resume())
    assert resumed.executed
    probe.moving()
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.until(lambda: "zero was published instead\n" in process.text, "its guard has acted")
    final_position()
    with executive(tmp_path):
        probe.moving()


def test_the_stages_of_a_lost_link_follow_while_a_silent_connection_is_open(
    probe: Probe, tmp_path: Path
) -> None:
    asset = tmp_path / "jackal.yaml"
    later = "{after_s: 1, then: stop}, {after_s: 1.5, then: return}"
    stages = f"{{after_s: 0.5, then: continue}}, {later}"
    usual = (config_folder() / "jackal.yaml").read_text(encoding="utf-8")
    asset.write_text(f"{usual}link_loss: {{teleop: [{stages}]}}\n", encoding="utf-8")
    with executive(tmp_path, "--asset", str(asset)) as (process, uri):
        until_located(uri)
        probe.standing()
        began = probe.fresh_truth().pose.pose.position
        with Octets(MalUri.parse(uri).port, "MOE") as silent:
            assert silent.request(LONG_DRIVE)
            process.output("the rover is back at the position of the last ground contact")
        ended = probe.fresh_truth().pose.pose.position
        assert (ended.x, ended.y) == pytest.approx((began.x, began.y), abs=0.1)
        reports = [n for n in reported(uri) if n.reason is Reason.LINK_LOST]
        notified = [(n.stage, n.text.partition(": ")[2]) for n in reports]
        assert notified == [
            (None, "the rover continues"),
            (None, "the rover is stopped"),
            (Stage.FAILED, "the rover is stopped"),
            (None, "the rover returns to the position of the last contact"),
        ]


@pytest.mark.usefixtures("ros_domain")
def test_a_second_process_on_one_ledger_is_refused(tmp_path: Path) -> None:
    with executive(tmp_path):
        arguments = ("--port", "0", "--data", str(tmp_path / "data"))
        with running(tmp_path / "second", "rover-executive", *arguments) as second:
            assert second.ended() == 1
            assert "another process" in second.text
            assert "Traceback" not in second.text


LEGS = '<moveForward distance="0.4" deadline_s="60"/><moveForward distance="1.5" deadline_s="90"/>'
PLAN = plan(f"<Sequence>{LEGS}</Sequence>")


def until_done(uri: str, done: int, *requests: Request) -> PlanStatus:
    """Send requests, then wait until so many leaves of the plan have ended; return its status."""

    async def follow(client: MrsClient) -> PlanStatus:
        await located(client)
        updates = await client.plan_updates()
        for request in requests:
            assert (await client.run(client.command(request))).executed
        async for update in updates:
            if update.done == done and update.status is not PlanStatus.ACTIVATED:
                return update.status
        raise AssertionError("the stream ended")

    return call_ground(uri, follow)


def test_killed_amid_a_plan_it_continues_on_command(probe: Probe, tmp_path: Path) -> None:
    start = probe.fresh_truth().pose.pose.position.x
    with executive(tmp_path) as (process, uri):
        until_done(uri, 1, SubmitPlan(PLAN), ActivatePlan("survey"))
        probe.moving()
        assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.standing()
    with executive(tmp_path) as (_, again):
        (found,) = call_ground(again, lambda client: client.get_plan_status())
        assert (found.status, found.done) == (PlanStatus.SUSPENDED, 1)
        past = reported(again)
        lifecycles = [
            (n.identity.command_id, n.stage)
            for n in past
            if n.identity is not None and n.identity.source == "plan:survey"
        ]
        assert (1, Stage.EXECUTED) in lifecycles
        assert lifecycles[-1] == (2, Stage.FAILED)
        killed_at = probe.fresh_truth().pose.pose.position.x
        assert killed_at - start > 0.4
        assert until_done(again, 2, ResumePlan("survey")) is PlanStatus.COMPLETED
        went = probe.fresh_truth().pose.pose.position.x - killed_at
        assert went == pytest.approx(1.5, abs=0.1)
