"""What goes to pages that are slow, new or back."""

import json
from dataclasses import replace

from adapters.console.messages import (
    AssetState,
    DictionaryChanged,
    LinkKind,
    LinkState,
    LinkStatus,
    Quality,
    Sample,
    encode,
)
from adapters.console.web import MAX_QUEUED, MAX_QUEUED_SAMPLES, REPLAY_BUFFER, Hub
from adapters.system import OPERATING_SYSTEM


def sample(number: int, value: float | None = None) -> Sample:
    given = float(number) if value is None else value
    return Sample("jackal", "POS_X", LinkKind.DIRECT, float(number), 0.0, given, Quality.GOOD)


async def test_for_a_slow_page_only_early_telemetry_is_dropped() -> None:
    hub = Hub(OPERATING_SYSTEM)
    page = hub.open("A", "anna")
    page.subscribe(["tm:*", "dictionary"])
    for number in range(MAX_QUEUED_SAMPLES + 500):
        hub.sample(sample(number))
        if number % 10 == 0:
            hub.publish(DictionaryChanged(f"asset{number}"))
    batch = json.loads(await page.batch())
    values = [message["value"] for message in batch if message["ty"] == "tm"]
    assert values == [float(number) for number in range(500, MAX_QUEUED_SAMPLES + 500)]
    assert batch[-1] == {"ty": "gap", "dropped": 500}
    assert (
        sum(message["ty"] == "dictionary" for message in batch) == (MAX_QUEUED_SAMPLES + 500) // 10
    )
    hub.sample(sample(0))
    assert [message["ty"] for message in json.loads(await page.batch())] == ["tm"]


async def test_a_page_that_takes_nothing_is_sent_away_and_can_resume() -> None:
    hub = Hub(OPERATING_SYSTEM)
    page = hub.open("A", "anna")
    page.subscribe(["dictionary"])
    began = hub.hello(page, resumed=False).seq
    for number in range(MAX_QUEUED + 1):
        hub.publish(DictionaryChanged(str(number)))
    assert page.too_slow
    assert not hub.can_resume(hub.instance, began)
    assert hub.can_resume(hub.instance, began + 1 + MAX_QUEUED - REPLAY_BUFFER)
    assert not hub.can_resume(hub.instance, began + MAX_QUEUED + 2)
    back = hub.open("A", "anna")
    back.resume(["dictionary"], began + MAX_QUEUED - 1)
    assert [message["asset"] for message in json.loads(await back.batch())] == ["19999", "20000"]


async def test_a_new_page_gets_the_present_state() -> None:
    hub = Hub(OPERATING_SYSTEM)
    for state in (LinkState.CONNECTING, LinkState.UP):
        hub.publish(LinkStatus("jackal", LinkKind.DIRECT, "uri", state, 0.0, None, ""))
    hub.sample(sample(1))
    hub.sample(sample(2))
    hub.sample(replace(sample(1), q=Quality.LATE))
    page = hub.open("A", "anna")
    page.subscribe(["link:jackal", "tm:jackal:POS_X"])
    batch = json.loads(await page.batch())
    assert [(message["ty"], message.get("state"), message.get("value")) for message in batch] == [
        ("link", "up", None),
        ("tm", None, 2.0),
    ]
    page.subscribe(["link"])  # nothing is new in it
    hub.publish(DictionaryChanged("jackal"))
    hub.sample(sample(3))
    hub.publish(LinkStatus("jackal", LinkKind.DIRECT, "uri", LinkState.DOWN, 0.0, None, ""))
    assert [message["state"] for message in json.loads(await page.batch())] == ["down"]


async def test_a_new_page_gets_last_where_an_asset_was_reached_last() -> None:
    hub = Hub(OPERATING_SYSTEM)
    for uri in ("one", "other", "one"):
        for state in (LinkState.UP, LinkState.DOWN):
            hub.publish(LinkStatus("jackal", LinkKind.DIRECT, uri, state, 0.0, None, ""))
    page = hub.open("A", "anna")
    page.subscribe(["link"])
    assert [message["uri"] for message in json.loads(await page.batch())] == ["other", "one"]


async def test_a_new_page_gets_no_mode_that_was_left() -> None:
    hub = Hub(OPERATING_SYSTEM)
    idle = AssetState("jackal", LinkKind.DIRECT, 1.0, "IDLE", None, 0, None)
    for state in (idle, replace(idle, mode="PLAN", plan="look"), idle):
        hub.publish(state)
    page = hub.open("A", "anna")
    page.subscribe(["asset"])
    assert [message["mode"] for message in json.loads(await page.batch())] == ["IDLE"]


def test_non_finite_values_are_written_so_that_browsers_read_them() -> None:
    written = [
        json.loads(encode(sample(0, value)))["value"]
        for value in (float("nan"), float("inf"), -float("inf"), 1e300)
    ]
    assert written == ["NaN", "Infinity", "-Infinity", 1e300]
