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
from adapters.mrs.spec import AssetInfo, AssetStatus, ReceivedReport
from adapters.mrs.transport import CLEAR
from adapters.system import OPERATING_SYSTEM
from executive.commands import MoveForward, Stop
from executive.values.clock import START_UTC_S as LANDED_S
from executive.values.parameters import Parameter, ParameterValue
from executive.values.reports import Report
from tests.console.conftest import Launch
from tests.console.consoles import LIMIT_S, JsonMessage, Operator, at_console
from tests.mrs.aboard import Aboard, LinkedBench


async def test_values_arrive_with_both_times_link_and_quality(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(
        tmp_path, rover.uri, "anna", topics=["link", "tm:jackal:BATERY_VOLTAGE"]
    ) as (anna,):
        await anna.page.is_up()

        async def log(utc_s: float, value: float | None) -> JsonMessage:
            reported = ParameterValue(Parameter.BATERY_VOLTAGE, utc_s, value)
            rover.do(lambda bench: bench.link.send_telemetry([reported]))
            return await anna.page.until(
                lambda message: message["ty"] == "tm" and message["utc"] == utc_s
            )

        first = await log(LANDED_S + 0.1, 26.0)
        assert (first["value"], first["link"], first["q"]) == (26.0, "direct", "good")
        assert first["rx"] == pytest.approx(time.time(), abs=LIMIT_S)
        assert (await log(LANDED_S + 0.3, 25.0))["q"] == "good"
        assert (await log(LANDED_S + 0.2, 25.5))["q"] == "late"
        unknown = await log(LANDED_S + 0.4, None)
        assert (unknown["value"], unknown["q"]) == (None, "invalid")
        rover.do(
            lambda bench: bench.link.send_telemetry(
                [ParameterValue(Parameter.BATERY_VOLTAGE, LANDED_S + 0.4, None)]
            )
        )
        assert (await log(LANDED_S + 0.5, 24.0))["q"] == "good"
        repeats = [message for message in anna.page.got if message.get("utc") == LANDED_S + 0.4]
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

        async def log(utc_s: float) -> JsonMessage:
            reported = ParameterValue(Parameter.BATERY_VOLTAGE, utc_s, 25.0)
            rover.do(lambda bench: bench.link.send_telemetry([reported]))
            return await anna.page.until(
                lambda message: message["ty"] == "tm" and message["utc"] == utc_s
            )

        await anna.page.is_up()
        assert (await log(LANDED_S + 3600.0))["q"] == "good"
        rover.hang_up()
        await anna.page.until(lambda message: message.get("state") == "down")
        rover.listen()
        await anna.page.is_up()
        assert (await log(LANDED_S + 0.1))["q"] == "good"
        assert (await log(LANDED_S + 0.3))["q"] == "good"
        assert (await log(LANDED_S + 0.2))["q"] == "late"


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
        await anna.page.until(lambda message: message.get("q") == "good")

        def set_back(bench: LinkedBench) -> None:
            now_s = bench.clock.now_s
            bench.clock.utc_s = lambda: LANDED_S - 3600.0 + now_s()  # type: ignore[method-assign]

        def is_in_time(message: JsonMessage) -> bool:
            return message.get("q") == "good" and message["utc"] < LANDED_S - 3000.0

        rover.do(set_back)
        await anna.page.until(is_in_time)
        in_transit = ParameterValue(Parameter.POS_X, LANDED_S + 3600.0, 1.0)
        rover.do(lambda bench: bench.link.send_telemetry([in_transit]))
        await anna.page.until(lambda message: message.get("utc") == in_transit.utc_s)
        await anna.page.until(is_in_time)
        living.cancel()
        await asyncio.gather(living, return_exceptions=True)


class Hung:
    """Loses its connection at the moment at which it is to end, and hears nothing else."""

    def __init__(self) -> None:
        self.receiving: asyncio.Task[None]
        self.ending: asyncio.Task[None] | None = None

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None

    async def last_known(self, _: RoverLink) -> None:
        return None

    def on_status(self, _: RoverLink, __: AssetStatus) -> None:
        self.ending = self.ending or asyncio.create_task(cancel_tasks((self.receiving,)))
        raise ConnectionError("lost")


async def test_it_ends_also_in_the_moment_of_a_lost_connection(launch: Launch) -> None:
    hung = Hung()
    link = RoverLink(launch().uri, CLEAR, cast("LinkListener", hung), OPERATING_SYSTEM)
    hung.receiving = asyncio.create_task(link.run())
    await asyncio.wait([hung.receiving], timeout=10.0)
    assert hung.receiving.cancelled()


class Catalogue:
    """A rover or an orbiter that has cursors 1 to 4 and 8, and a console that knows 4."""

    def __init__(self) -> None:
        self.received: list[int] = []

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None

    async def last_known(self, _: RoverLink) -> LastNotification:
        return LastNotification(4, 4)

    async def get_all_notifications(self, since: int) -> list[ReceivedReport]:
        return [
            ReceivedReport(each, cast("Report", SimpleNamespace(sequence=each, utc_s=each / 1e6)))
            for each in (1, 2, 3, 4, 8)
            if each >= since
        ]

    async def on_notification(self, _: RoverLink, received: ReceivedReport, __: float) -> None:
        self.received.append(received.report.sequence)


async def test_unrecorded_messages_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    catalogue, stream = Catalogue(), Stream[ReceivedReport]()
    link = RoverLink(
        "maltcp://127.0.0.1:1/MRS", CLEAR, cast("LinkListener", catalogue), OPERATING_SYSTEM
    )
    link.info = cast("AssetInfo", SimpleNamespace(asset="jackal"))
    stream.close()
    await link._receive_notifications(cast("MrsClient", catalogue), stream)
    assert catalogue.received == [8]
    assert "jackal: no longer has notifications 5 to 7" in caplog.text


async def test_a_restarted_rover_is_found_again_and_missed_reports_arrive(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        rover.hang_up()
        await anna.page.until(lambda message: message.get("state") == "down")
        rover.do(lambda bench: bench.submit(Stop(), 77))
        rover.listen()
        await anna.page.is_up()
        await anna.page.until(lambda message: message["ty"] == "cmd" and message["name"] == "stop")


async def test_reports_missed_while_the_console_was_down_are_requested_again(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        await anna.send("drive", "moveForward", distance=3.0)
        await anna.page.command("drive", "started")
    await asyncio.to_thread(rover.carry_out, MoveForward(0.5))
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        assert (await anna.page.command("drive", "executed"))["by"] == "anna"
        other = await anna.page.until(
            lambda message: message["ty"] == "cmd" and message["by"] == "MOE"
        )
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
        uncertain = await anna.page.command("drive", "unknown")
        assert not uncertain["ended"]
        assert "without its ledger" in uncertain["history"][-1]["detail"]
        other.close()


async def test_the_console_reports_its_own_state_and_its_links(
    rover: Aboard, tmp_path: Path
) -> None:
    async with at_console(tmp_path, rover.uri, "anna", topics=["tm"]) as (anna,):

        async def reported(key: str) -> JsonMessage:
            return await anna.page.until(lambda message: message.get("key") == key)

        pages = await reported("CONSOLE_PAGES")
        assert (pages["asset"], pages["link"]) == ("rover-console", "console")
        assert (await reported("CONSOLE_MEMORY"))["value"] > 1e7
        assert 0.0 < (await reported("LINK_ROUND_TRIP"))["value"] < 5.0
        assert (await reported("LINK_CLOCK_OFFSET"))["link"] == "direct"
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


async def test_a_returning_page_gets_the_missed_messages(rover: Aboard, tmp_path: Path) -> None:
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        hello = anna.page.got[0]
        await anna.send("drive", "moveForward", distance=0.5)
        seq = (await anna.page.command("drive", "started"))["seq"]
        async with anna.open_page() as other:
            await other.command("drive", "executed")
        await _resumes(anna, {"instance": hello["instance"], "seq": seq}, missed=True)
        await _resumes(anna, {"instance": "another", "seq": seq}, missed=False)


async def _resumes(anna: Operator, resume: JsonMessage, *, missed: bool) -> None:
    async with anna.open_page("cmd", resume=resume) as page:
        assert page.got[0]["resumed"] is missed
        reported = await page.command("drive", "executed")
        assert ("seq" in reported) is missed


async def test_a_page_gets_its_subscriptions(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["presence"]) as (anna,):
        await anna.page.until(lambda message: message["ty"] == "presence")
        await anna.page.send(op="sub", topics=["link"])
        await anna.page.is_up()
        assert {message["ty"] for message in anna.page.got} == {"hello", "presence", "link"}
        async with anna.open_page("presence", console="other") as other:
            seen = await other.until(lambda message: message["ty"] == "presence")
            assert [each["console"] for each in seen["consoles"]] == ["test", "other"]


async def test_a_rover_that_returns_at_another_address_is_followed(
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


async def test_a_rover_is_found_again_at_the_configured_address(
    launch: Launch, tmp_path: Path
) -> None:
    layer, reported = launch("scout"), launch("jackal")
    async with at_console(tmp_path, (layer.uri, reported.uri), "anna") as (anna,):
        assert (await anna.page.is_up())["uri"] == reported.uri
        reported.close()
        other = launch("jackal", service_layer=layer.uri)
        assert (await anna.page.is_up())["uri"] == other.uri
        other.close()
        back = launch("jackal", port=reported.port)
        assert (await anna.page.is_up())["uri"] == back.uri == reported.uri
