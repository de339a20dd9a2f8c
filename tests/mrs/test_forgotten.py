"""What the ground hears of commands that the rover's record no longer holds."""

import pytest

from adapters.mal import MalError
from adapters.mrs.ground.client import MrsClient
from adapters.mrs.spec.errors import AreaError
from adapters.mrs.spec.types import Notification
from executive.commands.catalogue import SetTravelSpeed
from executive.reasons import Reason
from executive.record.retention import Retention
from tests.mrs.aboard import Aboard, LinkedBench

KEPT, AT_ONCE = 20, 4


def forgetful(bench: LinkedBench) -> None:
    bench.executive.retention = Retention(bench.ledger, KEPT, AT_ONCE)


def test_the_past_begins_where_the_record_does_and_a_repeat_is_a_duplicate(aboard: Aboard) -> None:
    aboard.do(forgetful)

    async def session(client: MrsClient) -> tuple[Notification, ...]:
        for number in range(1, 31):
            await client.submit(client.command(SetTravelSpeed(0.5), command_id=number))
            aboard.run(0.1)
        with pytest.raises(MalError) as raised:
            await client.submit(client.command(SetTravelSpeed(0.5), command_id=1))
        assert raised.value.number == AreaError.DUPLICATE.value
        assert await client.get_notifications(command_id=1) == ()
        return await client.get_notifications(since=1)

    past = aboard.ground(session)
    first, last = past[0].sequence, past[-1].sequence
    assert first > 1
    assert [told.sequence for told in past] == list(range(first, last + 1))
    assert KEPT <= len(past) < KEPT + AT_ONCE + 1
    assert past[-1].code == Reason.DUPLICATE.value
    assert "so long ago" in str(past[-1].text)
