"""The nodes of a plan, as the MRS and the command line show them."""

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError
from executive.commands import ActivatePlan, SubmitPlan
from executive.values.plan_nodes import NodeStatus
from tests.mrs.aboard import raises
from tests.support.plans import plan

pytestmark = pytest.mark.usefixtures("running")

ASKS = plan("""<Sequence>
  <Ask name="ditch" question="Cross it?" options="cross;turn back" default="turn back"
       deadline_s="600" answer="{way}"/>
  <moveForward distance="1" deadline_s="60"/>
</Sequence>""")


async def test_the_nodes_of_a_plan_are_reported(client: MrsClient) -> None:
    with raises(AreaError.NOT_FOUND.value):
        await client.get_plan_nodes("survey")
    await client.run(client.command(SubmitPlan(ASKS)))
    nodes = await client.get_plan_nodes("survey")
    assert [(each.kind, each.line) for each in nodes] == [
        ("SubTree", 2),
        ("Sequence", 3),
        ("Ask", 4),
        ("moveForward", 6),
    ]
    assert {each.status for each in nodes} == {NodeStatus.IDLE}
    assert [each.tries for each in nodes] == [0] * 4
    await client.run(client.command(ActivatePlan("survey")))
