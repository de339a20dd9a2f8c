"""How the executive's process is doing, as its parameters tell."""

import asyncio
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import EXECUTIVE_HOUSEKEEPING
from adapters.onboard.housekeeping import ExecutiveHousekeeping
from adapters.ros import TickStatistics
from executive.commands import Resume
from executive.values.clock import START_UTC_S
from executive.values.reasons import Reason
from executive.values.reports import Report
from tests.core.test_pose_uncertainty import moved
from tests.mrs.aboard import Aboard, LinkedBench
from tests.mrs.aboard import rover as typed

SLOW = TickStatistics(20, 20, 1.0, max_period_s=0.125, max_tick_s=0.0625, overruns=3)
QUICK = TickStatistics(20, 20, 1.0, max_period_s=0.0625, max_tick_s=0.001, overruns=3)


@pytest.fixture
def rover(tmp_path: Path) -> Iterator[Aboard]:
    """Give a rover that tells of itself; of its ticks the worst of two seconds."""
    housekeeping = ExecutiveHousekeeping(tmp_path)
    for ticks in (SLOW, QUICK):
        housekeeping.note(ticks)
    with closing(Aboard(tmp_path, housekeeping=housekeeping)) as rover:
        rover.runs = True
        yield rover


def test_the_executive_reports_its_own_state_as_that_of_the_rover(rover: Aboard) -> None:
    async def session(client: MrsClient) -> dict[str, float | str | None]:
        while True:
            values = await client.get_value()
            found = {each.name: each.value for each in values}
            if found["EXEC_TICK"] is not None:
                break
            await asyncio.sleep(0.02)
        defined = {each.name: each.unit for each in await client.list_definition()}
        assert list(found) == list(defined)
        assert defined["EXEC_LEDGER"] == "B"
        (tick,) = await client.get_value("EXEC_TICK")
        begun_s, now_s = START_UTC_S, rover.do(lambda bench: bench.clock.utc_s())
        assert begun_s <= tick.utc_s <= now_s, "by the clock aboard"
        reported = {each.name for each in (await client.get_status()).values}
        assert reported == set(defined)
        return found

    found = rover.ground(session)
    assert {each.name for each in EXECUTIVE_HOUSEKEEPING} < found.keys()
    assert (found["EXEC_TICK"], found["EXEC_TICK_PERIOD"]) == (0.0625, 0.125)
    assert (found["EXEC_OVERRUNS"], found["EXEC_GOALS"]) == (3.0, 0.0)
    for name in ("EXEC_MEMORY", "EXEC_DISK_FREE", "EXEC_LEDGER"):
        size = found[name]
        assert isinstance(size, float), name
        assert size > 1000.0, name


UNCERTAINTY = ("EXEC_POSITION_UNCERTAINTY", "EXEC_HEADING_UNCERTAINTY")


def jump(bench: LinkedBench) -> Report:
    """Let the odometry jump, resume, and return the event of the pose that is uncertain."""
    bench.rover.pose = moved(bench.rover.pose, x_m=0.5)
    bench.run(0.5)
    bench.submit(Resume(), 90)
    bench.run(0.5)
    return next(each for each in bench.received.reports if each.reason is Reason.POSE_UNCERTAIN)


def test_the_uncertainty_of_the_pose_is_published_at_once(rover: Aboard) -> None:
    """With the time of its event, and not when housekeeping is measured the next time."""
    rover.runs = False
    rover.run(1.0)

    async def session(client: MrsClient) -> dict[str, float]:
        stream, found = await client.telemetry(), dict[str, float]()
        begun = await asyncio.to_thread(rover.do, jump)
        async for each in stream:
            if each.name in UNCERTAINTY and each.utc_s == pytest.approx(
                begun.utc_s, abs=1e-6, rel=0.0
            ):
                assert isinstance(each.value, float)
                found[each.name] = each.value
            if len(found) == len(UNCERTAINTY):
                return found
        raise AssertionError

    assert rover.ground(session) == dict(zip(UNCERTAINTY, (pytest.approx(0.5), 0.0), strict=True))


def test_status_and_watch_show_that_the_pose_is_uncertain(
    rover: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "400")
    certain = typed("status", "--to", rover.uri).output
    assert "uncertain by" not in certain
    assert "confirmPose" not in certain
    rover.runs = False
    rover.do(jump)
    uncertainty = rover.do(lambda bench: bench.executive.status.uncertainty)
    assert 0.5 <= uncertainty.position_m < 0.6
    message = f"the pose is uncertain by {uncertainty}, since odometry_jumped"
    lines = typed("status", "--to", rover.uri).output.splitlines()
    assert lines[1] == f"standing: no motion goal; {message}"
    (position,) = (line for line in lines if line.startswith("at x "))
    assert f", uncertain by {uncertainty}, video off" in position
    (remedy,) = (line for line in lines if line.startswith("the pose is uncertain: "))
    assert remedy.endswith("by rover command confirmPose 0 0")
    assert message in " ".join(typed("watch", "--once", "--to", rover.uri).output.split())
    *_, confirm = remedy.partition("rover command confirmPose")
    words = ("confirmPose", *confirm.split())
    assert typed("command", "--to", rover.uri, *words).exit_code == 0
    assert "uncertain by" not in typed("status", "--to", rover.uri).output
