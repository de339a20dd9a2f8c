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
from tests.relay.rover.place import DICTIONARY, SOURCE, Orbiter, Place
from tests.support.processes import LIMIT_S, Running, executive, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow]

LIFE = [Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED, Stage.EXECUTED]


def asked(request: Request, number: int) -> Message:
    return DICTIONARY.command(request, Identity(SOURCE, number), "JACKAL")


@pytest.fixture(scope="module")
def domain(module_ros_domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Give the domain of a simulation."""
    with simulation(tmp_path_factory.mktemp("sim")):
        yield module_ros_domain


@pytest.fixture
def place(domain: int, tmp_path: Path) -> Place:
    return Place(tmp_path, domain)


async def knows_where_it_is(orbiter: Orbiter) -> None:
    def told() -> bool:
        telemetry = [m for m in orbiter.messages if m.command == "TELEMETRY"]
        return bool(telemetry) and telemetry[-1].outputs[0] != ""

    await orbiter.until(told, "telemetry with a place")


async def test_commands_go_down_and_their_lives_come_up(place: Place) -> None:
    with executive(place.folder, "--relay"), place.relay() as relay:
        async with place.orbiter() as orbiter:
            await knows_where_it_is(orbiter)
            await orbiter.ask(asked(SetTravelSpeed(0.5), 1), asked(MoveForward(0.1), 2))
            await orbiter.until(lambda: orbiter.ended(1) and orbiter.ended(2), "two lives")
            assert orbiter.stages(1) == LIFE
            assert [s for s in orbiter.stages(2) if s is not Stage.PROGRESS] == LIFE
            await orbiter.ask(asked(DriveFor(0.3, 0.0, 50.0), 3))
            await orbiter.until(lambda: Stage.STARTED in orbiter.stages(3), "it drives")
            await orbiter.ask(asked(Stop(), 4))
            await orbiter.until(lambda: orbiter.ended(4), "it stands")
            assert orbiter.stages(3)[-1] is Stage.CANCELLED
            await orbiter.ask(asked(MoveForward(0.1), 5))
            await orbiter.until(lambda: orbiter.ended(5), "a refusal")
            (refused,) = [r for r in orbiter.reports if r.stage is Stage.REJECTED]
            assert refused.reason is Reason.WRONG_MODE
            await orbiter.until(
                lambda: {"LINK", "HOUSEKEEPING"} <= {m.command for m in orbiter.messages},
                "health of the relay and of the executive",
            )
        assert relay.end() == 0
        assert "Traceback" not in relay.text


async def test_the_executive_killed_ends_nothing_of_the_relay(place: Place) -> None:
    with place.relay():
        async with place.orbiter() as orbiter:
            with executive(place.folder, "--relay") as (process, _):
                await knows_where_it_is(orbiter)
                await orbiter.ask(asked(DriveFor(0.3, 0.0, 50.0), 1))
                await orbiter.until(lambda: Stage.STARTED in orbiter.stages(1), "it drives")
                assert process.end(signal.SIGKILL) == -signal.SIGKILL
            with executive(place.folder, "--relay"):
                await orbiter.until(lambda: orbiter.ended(1), "what became of it")
                assert orbiter.stages(1)[-1] is Stage.FAILED
                (end,) = [r for r in orbiter.reports if r.stage is Stage.FAILED]
                assert end.reason is Reason.INTERRUPTED
                await orbiter.ask(asked(SetTravelSpeed(0.4), 2))
                await orbiter.until(lambda: orbiter.ended(2), "it goes on")


async def test_what_came_while_the_executive_was_dead_is_for_the_next(place: Place) -> None:
    with place.relay():
        async with place.orbiter() as orbiter:
            with executive(place.folder, "--relay") as (process, _):
                await knows_where_it_is(orbiter)
                assert process.end(signal.SIGKILL) == -signal.SIGKILL
            await orbiter.ask(asked(SetTravelSpeed(0.4), 1))
            await orbiter.until(lambda: not orbiter.queued, "it is aboard")
            with executive(place.folder, "--relay"):
                await orbiter.until(lambda: orbiter.ended(1), "it is carried out")
                assert orbiter.stages(1) == LIFE


def test_a_plan_is_read_again_when_asked_for(place: Place) -> None:
    plan = place.folder / "contacts.ionrc"
    plan.write_text("a contact +0 +9000 1 2 125000\n")
    with place.config.open("a") as settings:
        settings.write("contact_plan: contacts.ionrc\n")

    async def session(process: Running) -> None:
        async with place.orbiter() as orbiter:
            await orbiter.ask(asked(SetTravelSpeed(0.4), 1))
            await orbiter.until(lambda: not orbiter.queued, "it is aboard")
            plan.write_text("a contact +0 +9000 2 1 often\n")
            process.send(signal.SIGUSR1)
            process.said("contact plan not reloaded, the present one stays: contact plan ")
            assert not orbiter.messages
            plan.write_text("a contact +0 +9000 2 1 125000\n")
            process.send(signal.SIGUSR1)
            await orbiter.until(lambda: bool(orbiter.messages), "what waited")

    with place.relay() as process:
        asyncio.run(session(process))


def test_who_stands_in_the_lock_can_be_asked_for_the_plan(place: Place) -> None:
    lock = place.folder / "relay" / "relay.lock"
    with place.relay_that_starts() as process:
        deadline_s = time.monotonic() + LIMIT_S
        while not lock.exists() or not lock.read_text():
            assert time.monotonic() < deadline_s, process.text
        process.send(signal.SIGUSR1)
        process.said("contact plan reloaded on request")
        assert process.end() == 0
    assert lock.read_text() == ""
