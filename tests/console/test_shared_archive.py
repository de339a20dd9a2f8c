"""Several consoles at one PostgreSQL: they show the same, and command once."""

import asyncio
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from itertools import pairwise
from pathlib import Path

import psycopg
import pytest
from sqlalchemy import select
from sqlalchemy.exc import DBAPIError

from adapters.console.archive import open_database
from adapters.console.archive.archive import WRITE_S
from adapters.console.archive.database import BOUNDS_MS, begin_writing
from executive.commands import MoveForward
from tests.console.conftest import Launch
from tests.console.consoles import JsonMessage, Operator, at_console
from tests.console.postgres import NEEDED, cluster, fresh
from tests.mrs.aboard import Aboard

FIRST = {"If-None-Match": "*"}


@asynccontextmanager
async def two_consoles(
    rover: Aboard, url: str, folder: Path
) -> AsyncIterator[tuple[Operator, Operator]]:
    """Give somebody at each of two consoles."""
    async with (
        at_console(folder / "one", rover.uri, "anna", archive=url) as (anna,),
        at_console(folder / "two", rover.uri, "ben", archive=url) as (ben,),
    ):
        for each in (anna, ben):
            await each.page.is_up()
        yield anna, ben


async def settled(anna: Operator, ben: Operator) -> list[JsonMessage]:
    """Return the commands as both consoles' pages find them, once they are the same."""
    async with asyncio.timeout(10.0):
        while True:
            here, there = [(await each.get("api/commands"))["commands"] for each in (anna, ben)]
            shown = [await standing(each) for each in (anna, ben)]
            if here == there and shown[0] == shown[1] == {each["id"]: each for each in here}:
                found: list[JsonMessage] = here
                return found
            await asyncio.sleep(0.1)


async def standing(operator: Operator) -> dict[str, JsonMessage]:
    """Return the commands that a new page is told of."""
    async with operator.open_page("cmd", "presence") as page:
        await page.until(lambda message: message["ty"] == "presence")
        return {
            message["id"]: {name: value for name, value in message.items() if name != "seq"}
            for message in page.got
            if message["ty"] == "cmd"
        }


async def test_a_command_of_one_console_is_the_same_at_the_other(
    guarded: Aboard, postgres: str, tmp_path: Path
) -> None:
    async with two_consoles(guarded, fresh(postgres), tmp_path) as (anna, ben):
        await anna.authority("request")
        await ben.page.holds("anna")
        assert (await ben.send("early", "moveForward", distance=0.5))[1]["holder"] == "anna"
        assert (await anna.send("drive", "moveForward", distance=0.5))[0] == 202
        for state in ("started", "executed"):
            shown = await ben.page.command("drive", state)
        assert (shown["name"], shown["args"], shown["by"]) == (
            "moveForward", {"distance": 0.5}, "anna",
        )  # fmt: skip
        assert shown["history"][0]["stage"] == "SENT"
        received = await ben.page.until(lambda message: message.get("stage") == "EXECUTED")
        assert received["command"] == "drive"
        await anna.page.command("drive", "executed")
        status, refused = await ben.send("drive", "moveForward", distance=0.5)
        assert (status, refused["command"]["id"]) == (409, "drive")
        stop = (await ben.request("POST", "api/stop/jackal"))[1]
        for each in (anna, ben):
            assert (await each.page.command(stop["id"], "executed"))["by"] == "ben"
        found = await settled(anna, ben)
        assert [(each["id"], each["by"]) for each in found] == [
            (stop["id"], "ben"),
            ("drive", "anna"),
        ]
        reported = [(await each.get("api/notifications"))["notifications"] for each in (anna, ben)]
        assert reported[0] == reported[1]
        for each in (anna, ben):
            ids = {message["id"] for message in each.page.got if message["ty"] == "cmd"}
            assert ids == {"drive", stop["id"]}


async def test_modes_and_authority_are_stored_once(
    guarded: Aboard, postgres: str, tmp_path: Path
) -> None:
    async with two_consoles(guarded, fresh(postgres), tmp_path) as (anna, ben):
        await anna.authority("request")
        await ben.page.holds("anna")
        await anna.send("drive", "moveForward", distance=0.5)
        await anna.page.command("drive", "executed")
        await anna.authority("release")
        for each in (anna, ben):
            await each.page.holds(None)

        async def stored(kind: str, *names: str) -> list[list[JsonMessage]]:
            found = (await ben.get(f"api/records/{kind}", asset="jackal"))["records"]
            return [[each[name] for name in names] for each in reversed(found)]

        async with asyncio.timeout(10.0):
            while len(await stored("auth", "holder")) < 3:
                await asyncio.sleep(0.1)
        await asyncio.sleep(2 * WRITE_S)  # what the other wrote would be there now
        assert await stored("auth", "holder") == [[None], ["anna"], [None]]
        states = await stored("asset", "mode", "active", "queued", "plan")
        assert all(one != other for one, other in pairwise(states)), states


async def test_a_command_of_another_source_is_the_same_at_both(
    rover: Aboard, postgres: str, tmp_path: Path
) -> None:
    async with two_consoles(rover, fresh(postgres), tmp_path) as (anna, ben):
        await asyncio.to_thread(rover.carry_out, MoveForward(0.2))
        await anna.page.until(lambda message: message.get("args") == {"distance": 0.2})
        (found,) = await settled(anna, ben)
        assert (found["state"], found["by"]) == ("executed", "MOE")
        assert found["args"] == {"distance": 0.2}


async def test_an_id_that_is_posted_to_both_at_once_is_sent_once(
    rover: Aboard, postgres: str, tmp_path: Path
) -> None:
    async with two_consoles(rover, fresh(postgres), tmp_path) as (anna, ben):
        names = [f"c{number}" for number in range(10)]
        answers = await asyncio.gather(
            *(
                each.send(name, "setCameraAngles", pan=0.1, tilt=0.0)
                for name in names
                for each in (anna, ben, anna)
            )
        )
        assert sorted(status for status, _ in answers) == [202] * 10 + [409] * 20
        for name in names:
            await anna.page.command(name, "executed")
        assert {each["id"] for each in await settled(anna, ben)} == set(names)
        reported = (await anna.get("api/notifications", limit=1000))["notifications"]
        assert [each["stage"] for each in reported].count("RECEIVED") == 10


async def test_what_one_missed_it_has_from_the_other(
    rover: Aboard, postgres: str, tmp_path: Path
) -> None:
    url = fresh(postgres)
    async with at_console(tmp_path / "two", rover.uri, "ben", archive=url) as (ben,):
        async with at_console(tmp_path / "one", rover.uri, "anna", archive=url) as (anna,):
            await anna.page.is_up()
            await anna.send("drive", "moveForward", distance=1.0)
            await anna.page.command("drive", "started")
        await ben.page.command("drive", "executed")
        async with at_console(tmp_path / "one", rover.uri, "anna", archive=url) as (anna,):
            (found,) = await settled(anna, ben)
            assert (found["state"], found["by"]) == ("executed", "anna")


async def test_an_object_stored_at_one_is_published_to_pages_of_the_other(
    launch: Launch, postgres: str, tmp_path: Path
) -> None:
    async with two_consoles(launch(), fresh(postgres), tmp_path) as (anna, ben):

        async def put(operator: Operator, value: int, revision: int | None) -> int:
            match = FIRST if revision is None else {"If-Match": f'"{revision}"'}
            request = {"json": {"value": value}, "headers": match}
            return (await operator.request("PUT", "api/objects/plot", **request))[0]

        assert await put(anna, 1, None) == 200
        reported = await ben.page.until(lambda message: message["ty"] == "obj")
        assert (reported["key"], reported["revision"]) == ("plot", 1)
        assert (await ben.get("api/objects/plot"))["value"] == 1
        assert await put(ben, 2, 1) == 200
        await anna.page.until(lambda message: message["ty"] == "obj" and message["revision"] == 2)
        assert await put(anna, 3, 1) == 412
        assert sorted(await asyncio.gather(put(anna, 4, 2), put(ben, 5, 2))) == [200, 412]
        last = {"headers": {"If-Match": '"3"'}}
        assert (await anna.request("DELETE", "api/objects/plot", **last))[0] == 204
        for each in (anna, ben):
            await each.page.until(
                lambda message: message["ty"] == "obj" and message["revision"] is None
            )
            revisions = [message["revision"] for message in each.page.got if message["ty"] == "obj"]
            assert revisions in ([1, 2, 3, None], [1, 2, None])


async def test_a_report_received_by_both_is_stored_once(
    rover: Aboard, postgres: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    url = fresh(postgres)
    async with two_consoles(rover, url, tmp_path) as (anna, ben):
        await anna.send("drive", "moveForward", distance=1.0)
        for each in (anna, ben):
            await each.page.command("drive", "executed")
    with psycopg.connect(url) as connection:
        samples = "SELECT count(*), count(DISTINCT (parameter, utc_us)) FROM sample"
        trees = "SELECT count(*), count(DISTINCT body) FROM record WHERE ty = 'tree'"
        for query in (samples, trees):
            (stored,) = connection.execute(query.encode())
            assert stored[0] == stored[1] > 0
        doubled = "SELECT count(*) - count(DISTINCT (asset, key, link)) FROM parameter"
        assert connection.execute(doubled.encode()).fetchone() == (0,)
    assert "cannot be written" not in caplog.text


def test_consoles_that_start_at_once_make_the_tables_once(postgres: str, tmp_path: Path) -> None:
    url = fresh(postgres)
    with ThreadPoolExecutor(4) as threads:
        for engine in threads.map(lambda _: open_database(url, tmp_path), range(4)):
            engine.dispose()


def test_a_console_blocked_in_a_write_does_not_delay_others(
    postgres: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = fresh(postgres)
    still, other = (open_database(url, tmp_path) for _ in range(2))
    # Only what is connected from now on has this bound: making the tables may take longer.
    monkeypatch.setitem(BOUNDS_MS, "idle_in_transaction_session_timeout", 200)
    still.dispose()
    with still.connect() as blocked:
        begin_writing(blocked)
        with other.begin() as writes:
            begin_writing(writes)
        with pytest.raises(DBAPIError, match="idle-in-transaction"):
            blocked.execute(select(1))
        blocked.invalidate()
    for each in (still, other):
        each.dispose()


def test_a_postgresql_that_is_silent_is_lost_unless_its_url_allows_it(
    postgres: str, tmp_path: Path
) -> None:
    engine = open_database(f"{fresh(postgres)}&tcp_user_timeout=60000", tmp_path)
    with engine.connect() as connection:
        driver = connection.connection.driver_connection
        assert isinstance(driver, psycopg.Connection)
        given = driver.info.get_parameters()
    assert (given["tcp_user_timeout"], given["keepalives_idle"]) == ("60000", "5")
    engine.dispose()


@pytest.mark.skipif(not NEEDED, reason="PostgreSQL is not installed: apt install postgresql")
async def test_a_killed_and_restarted_database_has_all_acknowledged_data(
    rover: Aboard, tmp_path: Path
) -> None:
    with cluster() as database:
        async with two_consoles(rover, database.url, tmp_path) as (anna, ben):
            await anna.send("before", "moveForward", distance=0.5)
            await ben.page.command("before", "executed")
            plot = {"json": {"value": 1}, "headers": FIRST}
            assert (await anna.request("PUT", "api/objects/plot", **plot))[0] == 200
            await anna.send("during", "moveForward", distance=3.0)
            await ben.page.command("during", "started")
            await asyncio.to_thread(database.kill)
            status, refused = await ben.send("no", "moveForward", distance=0.5)
            assert (status, "nothing was sent" in refused["error"]) == (503, True)
            for path in ("api/commands", "api/objects/plot"):
                status, refused = await anna.request("GET", path)
                assert (status, "archive cannot be used" in refused["error"]) == (503, True)
            rover.hang_up()
            for each in (anna, ben):
                await each.page.until(lambda message: message.get("state") == "down")
            rover.listen()
            for each in (anna, ben):
                await each.page.is_up()
                await each.page.command("during", "executed")
            status, stop = await ben.request("POST", "api/stop/jackal")
            assert status == 202
            for each in (anna, ben):
                await each.page.command(stop["id"], "executed")
            await asyncio.to_thread(database.start)
            await anna.send("go on", "resume")
            await ben.page.command("go on", "executed")
            found = await settled(anna, ben)
            assert [(each["id"], each["by"], each["state"]) for each in reversed(found)] == [
                ("before", "anna", "executed"),
                ("during", "anna", "executed"),
                (stop["id"], "ben", "executed"),
                ("go on", "anna", "executed"),
            ]
            assert (await ben.get("api/objects/plot"))["value"] == 1
            reported = (await ben.get("api/notifications", limit=1000))["notifications"]
            sequences = sorted(each["sequence"] for each in reported if each["sequence"])
            assert sequences == list(range(1, max(sequences) + 1))
