"""A plan outlives the process that carries it out."""

import asyncio
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec.types import PlanStatus, Stage
from executive.commands.catalogue import ActivatePlan, Request, ResumePlan, SubmitPlan
from tests.support.plans import plan
from tests.support.probe import Probe, probing
from tests.support.processes import executive, simulation

pytestmark = pytest.mark.ros

LEGS = '<moveForward distance="0.4" deadline_s="60"/><moveForward distance="3" deadline_s="90"/>'
PLAN = plan(f"<Sequence>{LEGS}</Sequence>")
LIMIT_S = 120.0


@pytest.fixture
def probe(ros_domain: int, tmp_path: Path) -> Iterator[Probe]:
    """Give a probe beside a simulation."""
    assert ros_domain
    with simulation(tmp_path, "--camera", "off"), probing() as probe:
        yield probe


def until_done(uri: str, done: int, *requests: Request) -> PlanStatus:
    """Send requests, then wait until so many leaves of the plan have ended; return its status."""

    async def session() -> PlanStatus:
        async with await MrsClient.connect(uri) as client:
            async for value in await client.telemetry():
                if value.name == "POS_X" and value.value is not None:
                    break
            updates = await client.plan_updates()
            for request in requests:
                assert (await client.run(client.command(request))).executed
            async for update in updates:
                if update.done == done and update.status is not PlanStatus.ACTIVATED:
                    return update.status
        raise AssertionError("the stream ended")

    return asyncio.run(asyncio.wait_for(session(), LIMIT_S))


def test_killed_amid_a_plan_it_goes_on_when_told_to(probe: Probe, tmp_path: Path) -> None:
    start = probe.fresh_truth().pose.pose.position.x
    with executive(tmp_path) as (process, uri):
        until_done(uri, 1, SubmitPlan(PLAN), ActivatePlan("survey"))
        probe.moving()
        assert process.end(signal.SIGKILL) == -signal.SIGKILL
    probe.standing()
    with executive(tmp_path) as (_, again):

        async def look() -> list[tuple[int | None, Stage | None]]:
            async with await MrsClient.connect(again) as client:
                (found,) = await client.get_plan_status()
                assert (found.status, found.done) == (PlanStatus.SUSPENDED, 1)
                past = await client.get_notifications()
                return [(n.commandId, n.stage) for n in past if n.source == "plan:survey"]

        lives = asyncio.run(look())
        assert (1, Stage.EXECUTED) in lives
        assert lives[-1] == (2, Stage.FAILED)
        killed_at = probe.fresh_truth().pose.pose.position.x
        assert killed_at - start > 0.4
        assert until_done(again, 2, ResumePlan("survey")) is PlanStatus.COMPLETED
        went = probe.fresh_truth().pose.pose.position.x - killed_at
        assert went == pytest.approx(3.0, abs=0.1)
