"""What a console hears of rovers: in time, late, after a loss, and after it was down itself."""

import asyncio
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from adapters.console.rovers.rover_link import LastNotification, LinkListener, RoverLink
from adapters.console.tasks import cancel_tasks
from adapters.mrs.ground import MrsClient, Stream
from adapters.mrs.spec import AssetInfo, AssetStatus, Notification
from adapters.mrs.transport import CLEAR
from adapters.system import OPERATING_SYSTEM
from executive.commands import MoveForward, Stop
from executive.values.clock import START_UTC_S as LANDED_S
from executive.values.parameters import Parameter, ParameterValue
from tests.console.conftest import Launch
from tests.console.consoles import LIMIT_S, Operator, Said, at_console
from tests.mrs.aboard import Aboard, LinkedBench


async def test_values_come_with_both_times_link_and_quality(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    async with at_console(
        tmp_path, rover.uri, "anna", topics=["link", "tm:jackal:BATERY_VOLTAGE"]
    ) as (anna,):
        await anna.page.is_up()

        async def tell(utc_s: float, value: float | None) -> Said:
            told = ParameterValue(Parameter.BATERY_VOLTAGE, utc_s, value)
            rover.do(lambda bench: bench.link.telemetry([told]))
            return await anna.page.until(lambda said: said["ty"] == "tm" and said["utc"] == utc_s)

        first = await tell(LANDED_S + 0.1, 26.0)
        assert (first["value"], first["link"], first["q"]) == (26.0, "direct", "good")
        assert first["rx"] == pytest.approx(time.time(), abs=LIMIT_S)
        assert (await tell(LANDED_S + 0.3, 25.0))["q"] == "good"
        assert (await tell(LANDED_S + 0.2, 25.5))["q"] == "late"
        unknown = await tell(LANDED_S + 0.4, None)
        assert (unknown["value"], unknown["q"]) == (None, "invalid")
        rover.do(
            lambda bench: bench.link.telemetry(
                [ParameterValue(Parameter.BATERY_VOLTAGE, LANDED_S + 0.4, None)]
            )
        )
        assert (await tell(LANDED_S + 0.5, 24.0))["q"] == "good"
        repeats = [said for said in anna.page.got if said.get("utc") == LANDED_S + 0.4]
        assert len(repeats) == 1
        found = await anna.get(
            "api/tm/jackal/BATERY_VOLTAGE", start=LANDED_S + 0.1, strategy="latest"
        )
        assert [each["value"] for each in found["samples"]] == [26.0, 25.5, 25.0, None, 24.0]
        last = await anna.post("api/tm:batch", keys=[["jackal", "BATERY_VOLTAGE"], ["no", "X"]])
        assert [each["value"] for each in last[1]["samples"]] == [24.0]


async def test_after_its_clock_was_set_back_the_values_of_a_new_session_are_in_time(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "tm"]) as (anna,):

        async def tell(utc_s: float) -> Said:
            told = ParameterValue(Parameter.BATERY_VOLTAGE, utc_s, 25.0)
            rover.do(lambda bench: bench.link.telemetry([told]))
            return await anna.page.until(lambda said: said["ty"] == "tm" and said["utc"] == utc_s)

        await anna.page.is_up()
        assert (await tell(LANDED_S + 3600.0))["q"] == "good"
        rover.hang_up()
        await anna.page.until(lambda said: said.get("state") == "down")
        rover.listen()
        await anna.page.is_up()
        assert (await tell(LANDED_S + 0.1))["q"] == "good"
        assert (await tell(LANDED_S + 0.3))["q"] == "good"
        assert (await tell(LANDED_S + 0.2))["q"] == "late"


async def test_after_its_clock_was_set_back_in_a_session_its_values_are_in_time_soon(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()

    async def live() -> None:
        while True:
            await asyncio.to_thread(rover.run, 0.5)
            await asyncio.sleep(0.05)

    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "tm:jackal:POS_X"]) as (
        anna,
    ):
        await anna.page.is_up()
        living = asyncio.create_task(live())
        await anna.page.until(lambda said: said.get("q") == "good")

        def set_back(bench: LinkedBench) -> None:
            now_s = bench.clock.now_s
            bench.clock.utc_s = lambda: LANDED_S - 3600.0 + now_s()  # type: ignore[method-assign]

        def is_in_time(said: Said) -> bool:
            return said.get("q") == "good" and said["utc"] < LANDED_S - 3000.0

        rover.do(set_back)
        await anna.page.until(is_in_time)
        on_the_way = ParameterValue(Parameter.POS_X, LANDED_S + 3600.0, 1.0)
        rover.do(lambda bench: bench.link.telemetry([on_the_way]))
        await anna.page.until(lambda said: said.get("utc") == on_the_way.utc_s)
        await anna.page.until(is_in_time)
        living.cancel()
        await asyncio.gather(living, return_exceptions=True)


class Hung:
    """Loses its connection at the moment at which it is to end, and hears nothing else."""

    def __init__(self) -> None:
        self.hearing: asyncio.Task[None]
        self.ending: asyncio.Task[None] | None = None

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None

    async def last_known(self, _: RoverLink) -> None:
        return None

    def on_status(self, _: RoverLink, __: AssetStatus) -> None:
        self.ending = self.ending or asyncio.create_task(cancel_tasks((self.hearing,)))
        raise ConnectionError("lost")


async def test_it_ends_also_at_the_moment_at_which_its_connection_is_lost(launch: Launch) -> None:
    hung = Hung()
    link = RoverLink(launch().uri, CLEAR, cast("LinkListener", hung), OPERATING_SYSTEM)
    hung.hearing = asyncio.create_task(link.run())
    await asyncio.wait([hung.hearing], timeout=10.0)
    assert hung.hearing.cancelled()


class Catalogue:
    """A rover or an orbiter that has cursors 1 to 4 and 8, and a console that knows 4."""

    def __init__(self) -> None:
        self.received: list[int] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None

    async def last_known(self, _: RoverLink) -> LastNotification:
        return LastNotification(4, 4)

    async def get_all_notifications(self, since: int) -> list[Notification]:
        return [
            cast("Notification", SimpleNamespace(sequence=each, cursor=each, timestamp=1000 * each))
            for each in (1, 2, 3, 4, 8)
            if each >= since
        ]

    async def on_notification(self, _: RoverLink, notification: Notification, __: float) -> None:
        self.received.append(notification.sequence)


async def test_what_is_not_recorded_any_more_is_logged(caplog: pytest.LogCaptureFixture) -> None:
    catalogue, stream = Catalogue(), Stream[Notification]()
    link = RoverLink(
        "maltcp://127.0.0.1:1/MRS", CLEAR, cast("LinkListener", catalogue), OPERATING_SYSTEM
    )
    link.info = cast("AssetInfo", SimpleNamespace(asset="jackal"))
    stream.close()
    await link._notifications(cast("MrsClient", catalogue), stream)
    assert catalogue.received == [8]
    assert "jackal: no longer has notifications 5 to 7" in caplog.text


async def test_a_rover_that_restarts_is_found_again_and_what_was_missed_comes(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        rover.hang_up()
        await anna.page.until(lambda said: said.get("state") == "down")
        rover.do(lambda bench: bench.submit(Stop(), 77))
        rover.listen()
        await anna.page.is_up()
        await anna.page.until(lambda said: said["ty"] == "cmd" and said["name"] == "stop")


async def test_what_happened_while_the_console_was_down_is_asked_for_again(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("drive", "moveForward", distance=3.0)
        await anna.page.command("drive", "started")
    await asyncio.to_thread(rover.carry_out, MoveForward(0.5))
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        assert (await anna.page.command("drive", "executed"))["by"] == "anna"
        other = await anna.page.until(lambda said: said["ty"] == "cmd" and said["by"] == "MOE")
        assert (other["name"], other["args"]) == ("moveForward", None)
        await anna.page.command(other["id"], "executed")
        sequences = [
            each["sequence"]
            for each in (await anna.get("api/notifications", limit=1000))["notifications"]
        ]
        assert sorted(sequences) == list(range(1, max(sequences) + 1))


async def test_a_rover_without_its_ledger_leaves_commands_unknown(tmp_path: Path) -> None:
    rover = Aboard(tmp_path / "first")
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("drive", "moveForward", distance=5.0)
        rover.run(0.5)
        await anna.page.command("drive", "started")
        rover.die()
        other = Aboard(tmp_path / "other", port=rover.port)
        doubted = await anna.page.command("drive", "unknown")
        assert not doubted["ended"]
        assert "without its ledger" in doubted["history"][-1]["detail"]
        other.close()


async def test_the_console_tells_of_itself_and_of_its_links(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna", topics=["tm"]) as (anna,):

        async def told(key: str) -> Said:
            return await anna.page.until(lambda said: said.get("key") == key)

        pages = await told("CONSOLE_PAGES")
        assert (pages["asset"], pages["link"]) == ("rover-console", "console")
        assert (await told("CONSOLE_MEMORY"))["value"] > 1e7
        assert 0.0 < (await told("LINK_ROUND_TRIP"))["value"] < 5.0
        assert (await told("LINK_CLOCK_OFFSET"))["link"] == "direct"
        console = (await anna.get("api/dictionary"))["console"]
        free = next(each for each in console["parameters"] if each["key"] == "CONSOLE_DISK_FREE")
        assert (free["unit"], free["low"]) == ("B", 100_000_000)
        await anna.get("api/tm/rover-console/CONSOLE_PAGES", link="console")


async def test_assets_that_are_registered_appear_by_themselves(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        scout = launch("scout", service_layer=rover.uri)
        scout.runs = True
        await anna.page.is_up("scout")
        dictionary = await anna.get("api/dictionary")
        assert list(dictionary["assets"]) == ["jackal", "scout"]
        assert not dictionary["assets"]["scout"]["ranges_known"]
        assert (await anna.send("there", "moveForward", "scout", distance=0.5))[0] == 202
        await anna.page.command("there", "executed")


async def test_a_page_that_comes_back_gets_what_it_missed(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        hello = anna.page.got[0]
        await anna.send("drive", "moveForward", distance=0.5)
        seq = (await anna.page.command("drive", "started"))["seq"]
        async with anna.open_page() as other:
            await other.command("drive", "executed")
        await _resumes(anna, {"instance": hello["instance"], "seq": seq}, missed=True)
        await _resumes(anna, {"instance": "another", "seq": seq}, missed=False)


async def _resumes(anna: Operator, resume: Said, *, missed: bool) -> None:
    async with anna.open_page("cmd", resume=resume) as page:
        assert page.got[0]["resumed"] is missed
        told = await page.command("drive", "executed")
        assert ("seq" in told) is missed


async def test_a_page_gets_what_it_subscribed_to(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["presence"]) as (anna,):
        await anna.page.until(lambda said: said["ty"] == "presence")
        await anna.page.say(op="sub", topics=["link"])
        await anna.page.is_up()
        assert {said["ty"] for said in anna.page.got} == {"hello", "presence", "link"}
        async with anna.open_page("presence", console="other") as other:
            seen = await other.until(lambda said: said["ty"] == "presence")
            assert [each["console"] for each in seen["consoles"]] == ["test", "other"]


async def test_a_rover_that_comes_back_at_another_address_is_followed(
    launch: Launch, tmp_path: Path
) -> None:
    layer = launch("scout")
    first = launch("jackal", service_layer=layer.uri)
    async with at_console(tmp_path, layer.uri, "anna") as (anna,):
        assert (await anna.page.is_up())["uri"] == first.uri
        first.close()
        second = launch("jackal", service_layer=layer.uri)
        assert second.uri != first.uri
        assert (await anna.page.is_up())["uri"] == second.uri
        second.runs = True
        await anna.send("there", "moveForward", distance=0.5)
        await anna.page.command("there", "executed")


async def test_a_rover_is_found_again_where_the_console_was_told_to_look(
    launch: Launch, tmp_path: Path
) -> None:
    layer, told = launch("scout"), launch("jackal")
    async with at_console(tmp_path, (layer.uri, told.uri), "anna") as (anna,):
        assert (await anna.page.is_up())["uri"] == told.uri
        told.close()
        elsewhere = launch("jackal", service_layer=layer.uri)
        assert (await anna.page.is_up())["uri"] == elsewhere.uri
        elsewhere.close()
        back = launch("jackal", port=told.port)
        assert (await anna.page.is_up())["uri"] == back.uri == told.uri
