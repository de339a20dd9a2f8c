"""Previews over the link: as parts of a message, and what refuses them."""

import asyncio
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mal import Consumer, MalError
from adapters.mrs.aboard import preview_service
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import AreaError, AskedMotion, asked_motion, motion_of
from executive.commands import Motion, MoveForward, MoveTo, Stop, Waypoint
from tests.mrs.aboard import raises
from tests.support.plans import AHEAD, plan


@given(st.one_of(*(st.from_type(kind) for kind in get_args(Motion))))
def test_a_motion_comes_back_from_its_parts(motion: Motion) -> None:
    assert repr(motion_of(asked_motion(motion))) == repr(motion)


async def test_a_rover_tells_what_a_motion_and_a_plan_come_to(client: MrsClient) -> None:
    told = await client.preview(MoveTo(Waypoint(3.0, 2.0, 1.5)))
    end = told.path[-1]
    assert (end.x, end.y, end.heading) == pytest.approx((3.0, 2.0, 1.5), abs=0.05)
    assert told.duration == end.time
    planned = await client.preview_plan(plan(f"<Sequence>{AHEAD}{AHEAD}</Sequence>"))
    assert planned.length == pytest.approx(8.0, abs=0.1)
    assert await client.get_plan_status() == ()
    assert await client.get_notifications() == ()


async def test_it_needs_no_mode_and_the_refusal_says_why(client: MrsClient) -> None:
    await client.submit(client.command(Stop()))
    assert (await client.preview(MoveForward(1.0))).length == pytest.approx(1.0, abs=0.05)
    with pytest.raises(MalError, match="distance 1000 m is above its bound of 100 m") as refused:
        await client.preview(MoveForward(1000.0))
    assert refused.value.number == AreaError.INVALID.value
    assert "(102 OUT_OF_RANGE)" in str(refused.value)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (AskedMotion("moveBy", None, None), "operation 'moveBy': one of moveTo, moveForward"),
        (AskedMotion("stop", None, None), "one of moveTo"),
        (AskedMotion("drive", None, (1.0,)), "has 3: travel, rotate, duration; 1 were given"),
        (AskedMotion("moveTo", (), None), "waypoints: moveTo has 1: target; 0 were given"),
        (AskedMotion("followPath", (), (1.0,)), "figures: followPath has 0; 1 were given"),
    ],
)
def test_parts_that_are_no_motion_are_refused(asked: AskedMotion, said: str) -> None:
    with pytest.raises(MalError) as refused:
        motion_of(asked)
    assert said in str(refused.value)


async def test_only_so_many_are_worked_out_at_once(consumer: Consumer) -> None:
    asked = ("MotionControl", "preview", "moveForward", None, (3.0,))
    most = preview_service.MOST_AT_ONCE
    first = [asyncio.create_task(consumer.request(*asked)) for _ in range(most)]
    await asyncio.sleep(0)
    with raises(AreaError.BUSY.value):
        await consumer.request(*asked)
    for told in await asyncio.gather(*first):
        assert told[0].length == pytest.approx(3.0, abs=0.1)
    await consumer.request("MotionControl", "preview", "moveForward", None, (1.0,))
