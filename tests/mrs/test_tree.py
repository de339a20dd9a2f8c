"""The behaviour tree by the MRS, on real sockets: whole at first, then what differs."""

import asyncio

from adapters.mrs.ground import MrsClient
from executive.commands import MoveForward
from tests.mrs.aboard import Aboard
from trees import Snapshot, snapshot_of


def aboard_now(aboard: Aboard) -> Snapshot:
    return aboard.do(lambda bench: snapshot_of(bench.executive, bench.clock.utc_s()))


async def test_the_tree_is_told_whole_and_then_as_it_changes(
    client: MrsClient, aboard: Aboard
) -> None:
    trees = await client.tree_snapshots()
    first = await anext(trees)
    assert first.nodes == aboard_now(aboard).nodes
    await client.submit(client.command(MoveForward(1.0), command_id=7))
    await asyncio.to_thread(aboard.run, 1.0)
    now = aboard_now(aboard)
    async for each in trees:
        if each.tick == now.tick:
            break
    assert each == now
    assert str(each.active) == "MOE:7"
