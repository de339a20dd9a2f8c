"""A console on a computer with another time of day tells and keeps no real time."""

import time
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any

from sqlalchemy import inspect, text

from adapters.console.archive import open_database
from executive.values.clock import START_UTC_S
from tests.console.conftest import NEEDED, Launch
from tests.console.consoles import ALL, Operator, at_console
from tests.console.test_alarms import BATTERY, LOW_V, acknowledge, is_alarm, show
from tests.mrs.aboard import Aboard
from tests.support.plans import AHEAD, plan
from tests.support.timed_system import TimedSystem

NOW_S = START_UTC_S + 5.0
NEAR_S = 3600.0


class Simulated(TimedSystem):
    """Has a clock that stands, and a random generator that repeats itself."""

    def __init__(self) -> None:
        super().__init__(lambda: NOW_S)
        self.random_octets = Random(1).randbytes


def is_real(figure: float) -> bool:
    """Whether a figure is about the time that it is, in seconds or microseconds."""
    return any(abs(figure / scale - time.time()) < NEAR_S for scale in (1.0, 1e6))


def real_times(reported: Any, at: str = "") -> Iterator[str]:
    """Yield where a real time is in what was told; the disk of the rover dates its files by it."""
    match reported:
        case dict():
            for name, value in reported.items():
                if name != "modified":
                    yield from real_times(value, f"{at}.{name}")
        case list():
            for value in reported:
                yield from real_times(value, at)
        case int() | float() if is_real(reported):
            yield at


def stored(folder: Path) -> Iterator[tuple[str, Any]]:
    """Yield each figure of an archive, with its table and column."""
    engine = open_database(None, folder)
    with engine.connect() as connection:
        for table in inspect(engine).get_table_names():
            for row in connection.execute(text(f"SELECT * FROM {table}")).mappings():
                yield from ((f"{table}.{name}", value) for name, value in row.items())
    engine.dispose()


async def work(anna: Operator, rover: Aboard) -> None:
    """Have all that is done by request done once."""
    await anna.page.is_up()
    assert (await anna.authority("request"))[1]["utc"] == NOW_S
    body = {"id": "p1", "plan_id": "survey", "content": plan(AHEAD).content.decode()}
    assert (await anna.post("api/plans/jackal", **body))[1]["created"] == NOW_S
    await anna.page.command("p1", "executed")
    show(rover, LOW_V)
    await acknowledge(anna, await anna.page.until(is_alarm(BATTERY)))
    await anna.page.until(is_alarm(BATTERY, acknowledged=NOW_S))
    headers = {"If-None-Match": "*"}
    status, _ = await anna.request("PUT", "api/objects/a", json={"value": 1}, headers=headers)
    assert status == 200
    wanted = {"asset": "jackal", "path": "pictures/rock.jpg"}
    assert (await anna.request("POST", "api/transfers", json=wanted))[1]["created"] == NOW_S
    await anna.page.until(
        lambda message: message["ty"] == "transfer" and message["state"] == "done"
    )
    await anna.page.until(lambda message: message.get("asset") == "rover-console")


async def test_all_times_are_those_of_the_system(launch: Launch, tmp_path: Path) -> None:
    rover = launch(authority=NEEDED)
    rover.put("pictures/rock.jpg", b"\xff\xd8\xff\xd9")
    rover.runs = True
    topics = (*ALL, "tm", "tree", "transfer")
    async with at_console(tmp_path, rover.uri, "anna", topics=topics, system=Simulated()) as (
        anna,
    ):
        await work(anna, rover)
        (hello,) = [message for message in anna.page.got if message["ty"] == "hello"]
        assert (hello["utc"], hello["instance"]) == (NOW_S, Random(1).randbytes(8).hex())
        found = [await anna.get(f"api/{path}") for path in ("alarms", "plans/jackal", "transfers")]
        assert list(real_times([anna.page.got, found])) == []
    figures = [(at, value) for at, value in stored(tmp_path / "console") if isinstance(value, int)]
    received = {value for at, value in figures if at.endswith(".rx_us")}
    assert received == {round(NOW_S * 1e6)}
    assert [at for at, value in figures if is_real(value)] == []
    tables = {at.partition(".")[0] for at, _ in figures}
    assert {"alarm", "command", "notification", "object", "plan", "record", "sample"} <= tables
