"""rover-relay, rover-executive and rover-sim as processes; the orbiter's agent is in the test."""

import asyncio
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mops import Message
from executive.commands.catalogue import DriveFor, MoveForward, Request, SetTravelSpeed, Stop
from executive.values.reasons import Reason
from executive.values.reports import Identity, Stage
from tests.relay.rover.relay_pair import DICTIONARY, SOURCE, Orbiter, RelayPair
from tests.support.processes import LIMIT_S, Running, executive, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow]

STAGES = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


def request_message(request: Request, number: int) -> Message:
    return DICTIONARY.command(request, Identity(SOURCE, number), "JACKAL")


@pytest.fixture(scope="module")
def domain(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give the domain of a simulation."""
    with simulation(tmp_path_factory.mktemp("sim")):
        yield module_ros_domain


@pytest.fixture
def relay_pair(domain: int, tmp_path: Path) -> RelayPair:
    return RelayPair(tmp_path, domain)


async def knows_where_it_is(orbiter: Orbiter) -> None:
    def reported() -> bool:
        telemetry = [m for m in orbiter.messages if m.command == "TELEMETRY"]
        return bool(telemetry) and telemetry[-1].outputs[0] != ""

    await orbiter.until(reported, "telemetry with a place")


async def test_commands_are_uplinked_and_their_reports_downlinked(relay_pair: RelayPair) -> None:
    with executive(relay_pair.folder, "--relay"), relay_pair.relay() as relay:
        async with relay_pair.orbiter() as orbiter:
            await knows_where_it_is(orbiter)
            await orbiter.request(
                request_message(SetTravelSpeed(0.5), 1), request_message(MoveForward(0.1), 2)
            )
            await orbiter.until(lambda: orbiter.ended(1) and orbiter.ended(2), "two lives")
            assert orbiter.stages(1) == STAGES
            assert [s for s in orbiter.stages(2) if s is not Stage.PROGRESS] == STAGES
            await orbiter.request(request_message(DriveFor(0.3, 0.0, 50.0), 3))
            await orbiter.until(lambda: Stage.STARTED in orbiter.stages(3), "it drives")
            await orbiter.request(request_message(Stop(), 4))
            await orbiter.until(lambda: orbiter.ended(4), "it stands")
            assert orbiter.stages(3)[-1] is Stage.CANCELLED
            await orbiter.request(request_message(MoveForward(0.1), 5))
            await orbiter.until(lambda: orbiter.ended(5), "a refusal")
            (refused,) = [r for r in orbiter.reports if r.stage is Stage.REJECTED]
            assert refused.reason is Reason.WRONG_MODE
            await orbiter.until(
                lambda: {"LINK", "HOUSEKEEPING"} <= {m.command for m in orbiter.messages},
                "health of the relay and of the executive",
            )
        assert relay.end() == 0
        assert "Traceback" not in relay.text


async def test_the_executive_killed_ends_nothing_of_the_relay(relay_pair: RelayPair) -> None:
    with relay_pair.relay():
        async with relay_pair.orbiter() as orbiter:
            with executive(relay_pair.folder, "--relay") as (process, _):
                await knows_where_it_is(orbiter)
                await orbiter.request(request_message(DriveFor(0.3, 0.0, 50.0), 1))
                await orbiter.until(lambda: Stage.STARTED in orbiter.stages(1), "it drives")
                assert process.end(signal.SIGKILL) == -signal.SIGKILL
            with executive(relay_pair.folder, "--relay"):
                await orbiter.until(lambda: orbiter.ended(1), "what became of it")
                assert orbiter.stages(1)[-1] is Stage.FAILED
                (end,) = [r for r in orbiter.reports if r.stage is Stage.FAILED]
                assert end.reason is Reason.INTERRUPTED
                await orbiter.request(request_message(SetTravelSpeed(0.4), 2))
                await orbiter.until(lambda: orbiter.ended(2), "it goes on")


async def test_a_command_that_arrived_without_an_executive_is_for_the_next(
    relay_pair: RelayPair,
) -> None:
    with relay_pair.relay():
        async with relay_pair.orbiter() as orbiter:
            with executive(relay_pair.folder, "--relay") as (process, _):
                await knows_where_it_is(orbiter)
                assert process.end(signal.SIGKILL) == -signal.SIGKILL
            await orbiter.request(request_message(SetTravelSpeed(0.4), 1))
            await orbiter.until(lambda: not orbiter.queued, "it is aboard")
            with executive(relay_pair.folder, "--relay"):
                await orbiter.until(lambda: orbiter.ended(1), "it is carried out")
                assert orbiter.stages(1) == STAGES


def test_a_plan_is_read_again_on_request(relay_pair: RelayPair) -> None:
    plan = relay_pair.folder / "contacts.ionrc"
    plan.write_text("a contact +0 +9000 1 2 125000\n")
    with relay_pair.config.open("a") as settings:
        settings.write("contact_plan: contacts.ionrc\n")

    async def session(process: Running) -> None:
        async with relay_pair.orbiter() as orbiter:
            await orbiter.request(request_message(SetTravelSpeed(0.4), 1))
            await orbiter.until(lambda: not orbiter.queued, "it is aboard")
            plan.write_text("a contact +0 +9000 2 1 often\n")
            process.send(signal.SIGUSR1)
            process.output("contact plan not reloaded, the present one stays: contact plan ")
            assert not orbiter.messages
            plan.write_text("a contact +0 +9000 2 1 125000\n")
            process.send(signal.SIGUSR1)
            await orbiter.until(lambda: bool(orbiter.messages), "what waited")

    with relay_pair.relay() as process:
        asyncio.run(session(process))


def test_the_holder_of_the_lock_can_be_requested_to_read_the_plan(relay_pair: RelayPair) -> None:
    lock = relay_pair.folder / "relay" / "relay.lock"
    with relay_pair.relay_that_starts() as process:
        deadline_s = time.monotonic() + LIMIT_S
        while not lock.exists() or not lock.read_text():
            assert time.monotonic() < deadline_s, process.text
        process.send(signal.SIGUSR1)
        process.output("contact plan reloaded on request")
        assert process.end() == 0
    assert lock.read_text() == ""
