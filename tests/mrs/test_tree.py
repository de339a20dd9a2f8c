"""The behaviour tree by the MRS, on real sockets: whole at first, then what differs."""

import asyncio
from dataclasses import replace

import pytest

from adapters.mal import Consumer, Subscription, UpdateHeader
from adapters.mrs.aboard import query_services
from adapters.mrs.ground import MrsClient, Stream
from adapters.mrs.spec import AreaError, TreeUpdate
from adapters.mrs.spec.tree_updates import change_update, snapshot_of_update, whole_update
from adapters.mrs.spec.types import NodeChange, NodeStatus
from executive.commands import ActivatePlan, MoveForward, Stop, SubmitPlan
from executive.values.reports import Identity
from tests.mrs.aboard import Aboard, raises
from tests.support.kinematic import STEP_S
from tests.support.plans import AHEAD, plan
from trees import TreeSnapshot, preview, snapshot_of

ROUND_TRIPS = 20


def now(aboard: Aboard) -> TreeSnapshot:
    return aboard.do(lambda bench: snapshot_of(bench.executive, bench.clock.utc_s()))


async def seen(trees: Stream[TreeSnapshot], wanted: TreeSnapshot) -> None:
    """Wait for a snapshot."""
    async for each in trees:
        if each == wanted:
            return
    raise AssertionError(f"the stream ended before {wanted}")


@pytest.fixture
def hasty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the tree be looked at all the time, and told at once."""
    monkeypatch.setattr(query_services, "POLL_S", 0.0)
    monkeypatch.setattr(query_services, "FIGURES_ONLY_S", 0.0)


async def test_the_tree_is_published_completely_and_then_as_it_changes(
    client: MrsClient, aboard: Aboard
) -> None:
    trees = await client.tree_snapshots()
    assert await anext(trees) == now(aboard)
    await client.submit(client.command(MoveForward(1.0), command_id=7))
    await asyncio.to_thread(aboard.run, 1.0)
    await seen(trees, moving := now(aboard))
    assert (moving.mode, moving.active) == ("MOVING", Identity("MOE", 7))
    await client.submit(client.command(Stop(), command_id=8))
    await asyncio.to_thread(aboard.run, STEP_S)
    await seen(trees, now(aboard))


async def test_the_tree_of_a_plan_is_published(client: MrsClient, aboard: Aboard) -> None:
    trees = await client.tree_snapshots()
    await client.submit(client.command(SubmitPlan(plan(AHEAD))))
    await client.submit(client.command(ActivatePlan("survey")))
    await asyncio.to_thread(aboard.run, 1.0)
    await seen(trees, planned := now(aboard))
    assert "plan:survey" in {each.path for each in planned.nodes}


@pytest.mark.usefixtures("hasty")
async def test_only_differences_are_published_and_nothing_without_any(
    consumer: Consumer, aboard: Aboard
) -> None:
    updates: list[TreeUpdate] = []

    def receive(_: UpdateHeader, update: TreeUpdate) -> None:
        updates.append(update)

    await consumer.subscribe("Status", "monitorTree", Subscription(subscriptionId="all"), receive)
    for _ in range(ROUND_TRIPS):
        await consumer.request("Status", "getStatus")
    (whole,) = updates
    standing = snapshot_of_update(whole, None)
    assert (whole.nodes is not None, standing) == (True, now(aboard))
    aboard.do(lambda bench: bench.submit(MoveForward(1.0), 1))
    while updates[-1].mode.name != "MOVING":
        await consumer.request("Status", "getStatus")
    changed = updates[-1]
    assert changed.nodes is None
    assert changed.changes is not None
    assert 0 < len(changed.changes) < len(standing.nodes)
    assert snapshot_of_update(changed, standing) == now(aboard)


@pytest.mark.usefixtures("hasty")
async def test_the_core_is_not_queried_without_subscribers(
    consumer: Consumer, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[float] = []

    def count(*arguments: object) -> TreeSnapshot:
        taken.append(1)
        return snapshot_of(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(query_services, "snapshot_of", count)
    everything = ("Status", "monitorTree", Subscription(subscriptionId="all"))
    for _ in range(ROUND_TRIPS):
        await consumer.request("Status", "getStatus")
    assert not taken
    await consumer.subscribe(*everything, lambda *_: None)
    while not taken:
        await consumer.request("Status", "getStatus")
    await consumer.unsubscribe("Status", "monitorTree", "all")
    await consumer.request("Status", "getStatus")
    requested = len(taken)
    for _ in range(ROUND_TRIPS):
        await consumer.request("Status", "getStatus")
    assert len(taken) == requested


def test_each_subscriber_gets_the_complete_tree(aboard: Aboard) -> None:
    async def session(one: MrsClient) -> None:
        trees = await one.tree_snapshots()
        await anext(trees)
        async with await MrsClient.connect(aboard.uri) as two:
            assert await anext(await two.tree_snapshots()) == now(aboard)

    aboard.ground(session)


async def test_the_stream_continues_after_a_lost_link(client: MrsClient, aboard: Aboard) -> None:
    trees = await client.tree_snapshots()
    await anext(trees)
    aboard.hang_up()
    aboard.do(lambda bench: bench.submit(MoveForward(1.0), 1))
    aboard.run(1.0)
    aboard.listen()
    await seen(trees, now(aboard))


@pytest.mark.usefixtures("hasty")
async def test_a_change_of_a_tree_that_did_not_arrive_is_ignored(
    client: MrsClient, aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    wholes: list[TreeSnapshot] = []
    changes: list[TreeUpdate | None] = []

    def stored(number: int, snapshot: TreeSnapshot) -> TreeUpdate:
        wholes.append(snapshot)
        return whole_update(number, snapshot)

    def of_another(number: int, whole: TreeSnapshot, snapshot: TreeSnapshot) -> TreeUpdate | None:
        changes.append(change_update(number + 1, whole, snapshot))
        return changes[-1]

    monkeypatch.setattr(query_services, "whole_update", stored)
    monkeypatch.setattr(query_services, "change_update", of_another)
    trees = await client.tree_snapshots()
    received = [await anext(trees)]
    aboard.do(lambda bench: bench.submit(MoveForward(1.0), 1))
    while not changes:
        await client.get_pose()
    monkeypatch.setattr(query_services, "FULL_UPDATE_S", 0.0)
    aboard.run(STEP_S)
    while received[-1] != now(aboard):
        received.append(await anext(trees))
    assert received == wholes[: len(received)]


@pytest.fixture
def tree(aboard: Aboard) -> TreeSnapshot:
    """Give a tree as it stands."""
    nodes = preview(aboard.do(lambda bench: bench.settings))
    return TreeSnapshot(1, 1_800_000_000.0, "IDLE", "stands", nodes, (), "nothing")


def test_an_update_that_fits_no_tree_is_refused(tree: TreeSnapshot) -> None:
    whole, beyond = whole_update(1, tree), NodeChange(index=len(tree.nodes), status=NodeStatus.IDLE)
    assert snapshot_of_update(whole, None) == tree
    assert whole.nodes is not None
    for update, known, message in (
        (replace(whole, nodes=whole.nodes[1:]), None, "has no parent"),
        (replace(whole, nodes=None), None, "unknown full tree"),
        (replace(whole, nodes=None, changes=(beyond,)), tree, "changed"),
    ):
        with pytest.raises(ValueError, match=message):
            snapshot_of_update(update, known)


async def test_a_rover_without_history_reports_it(client: MrsClient) -> None:
    with raises(AreaError.NOT_SUPPORTED.value):
        await client.get_history()
