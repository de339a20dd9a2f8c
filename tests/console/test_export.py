"""What the archive keeps, for other programs."""

import csv
import io
import json
from functools import partial
from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from adapters.console.archive import AlarmRaised, Archive, Written, change_alarms, open_database
from adapters.console.messages import (
    CommandState,
    CommandStatus,
    LinkKind,
    NotificationMessage,
    PlanProgress,
    Quality,
    Sample,
    StageEntry,
    TreeNode,
    TreeState,
    plain,
)
from adapters.system import OPERATING_SYSTEM
from tests.console.consoles import Operator, operator, served

UNREACHABLE = "127.0.0.1:1"
BEGAN_S = 4_000_000_000
"""Nothing of it is too old to be kept."""
COUNT = 25_000
"""More than are read at once."""


async def fill(folder: Path) -> None:
    folder.mkdir()
    archive = Archive(open_database(None, folder), OPERATING_SYSTEM.utc_s)
    for number in range(COUNT):
        at_s, value = float(BEGAN_S + number), float(number)
        archive.put(Sample("jackal", "POS_X", LinkKind.DIRECT, at_s, at_s + 1, value, Quality.GOOD))
    archive.put(Sample("scout", "HEAD", LinkKind.RELAY, BEGAN_S, BEGAN_S, None, Quality.INVALID))
    await archive.close()


async def export(anna: Operator, query: str) -> bytes:
    async with anna.session.get(f"{anna.address}api/export?{query}") as answer:
        assert answer.status == 200
        return await answer.read()


async def test_telemetry_is_exported_whole(tmp_path: Path) -> None:
    await fill(tmp_path / "console")
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:
        header, *lines = (await export(anna, "asset=jackal")).decode().splitlines()
        assert header == "utc,rx,asset,link,key,value,quality,unit"
        times = "2096-10-02T07:06:41.000000Z,2096-10-02T07:06:42.000000Z"
        assert lines[1] == f"{times},jackal,direct,POS_X,1.0,good,"
        assert [float(line.split(",")[5]) for line in lines] == list(range(COUNT))

        units = {each["key"]: each["unit"] for each in await table(anna, "tm", "rover-console")}
        assert units["CONSOLE_MEMORY"] == "B"

        part = io.BytesIO(await export(anna, f"format=mcap&start={BEGAN_S + 7}&end={BEGAN_S + 8}"))
        messages = [message for _, _, message in make_reader(part).iter_messages()]
        assert [json.loads(message.data) for message in messages] == [
            {"value": 7.0, "quality": "good"},
            {"value": 8.0, "quality": "good"},
        ]
        assert messages[0].publish_time == (BEGAN_S + 7) * 10**9
        assert messages[0].log_time == (BEGAN_S + 8) * 10**9

        whole = make_reader(io.BytesIO(await export(anna, "format=mcap"))).get_summary()
        assert whole is not None
        assert whole.statistics is not None
        counts = whole.statistics.channel_message_counts
        found = {channel.topic: counts[number] for number, channel in whole.channels.items()}
        rovers = {topic: count for topic, count in found.items() if "console" not in topic}
        assert rovers == {"/jackal/direct/POS_X": COUNT, "/scout/relay/HEAD": 1}


COMMAND = CommandStatus(
    id="a-1",
    asset="jackal",
    name="moveForward",
    args={"distance": 3.0},
    by="anna",
    source="anna",
    number=1,
    link=LinkKind.DIRECT,
    state=CommandState.EXECUTED,
    ended=True,
    created=BEGAN_S + 1.0,
    deadline=None,
    history=(
        StageEntry("SENT", "console", BEGAN_S + 1.0, BEGAN_S + 1.0, ""),
        StageEntry("STARTED", "jackal", BEGAN_S + 2.0, BEGAN_S + 2.5, "", figures={"a": 1.0}),
        StageEntry("EXECUTED", "jackal", BEGAN_S + 5.0, BEGAN_S + 5.5, "done"),
    ),
)
REPORTS = [
    NotificationMessage(
        asset="jackal",
        link=LinkKind.DIRECT,
        sequence=number,
        utc=BEGAN_S + number / 1000,
        rx=BEGAN_S + number / 1000 + 0.5,
        kind="EVENT",
        severity=severity,
        text=f"number {number}",
        command=None,
        stage=None,
        code=None,
        step=None,
        steps=None,
        figures={},
    )
    for number, severity in enumerate(["INFORMATIONAL", "WARNING", "CRITICAL"] * 400)
]
"""More than are read at once."""
TREE = TreeState(
    *("jackal", LinkKind.DIRECT, BEGAN_S + 3.0, 7, "MOVING", "for anna:1", "anna:1", ()),
    nodes=(
        TreeNode("rover", "rover", 0, "SELECTOR", "running", "", None),
        TreeNode("rover/drive", "drive", 1, "LEAF", "running", "1 m", "anna:1"),
    ),
)
PLAN = PlanProgress("jackal", "look", "EXECUTING", BEGAN_S + 4.0, "look/drive", 1, 2, "")


async def test_exported_notifications_match_the_archive(tmp_path: Path) -> None:
    folder = tmp_path / "console"
    folder.mkdir()
    archive = Archive(open_database(None, folder), OPERATING_SYSTEM.utc_s)
    reported: list[Written] = [COMMAND, *REPORTS, TREE, PLAN]
    for message in reported:
        archive.put(message)
    await archive.write(
        partial(
            change_alarms, changes=[AlarmRaised("jackal", "fault", BEGAN_S + 6.0, "SEVERE", "hot")]
        )
    )
    await archive.close()
    async with served(tmp_path, UNREACHABLE) as address, operator(address, "anna") as anna:
        what = "commands,reports,tree,plans,alarms"
        octets = await export(anna, f"asset=jackal&format=mcap&content={what}")
        read: dict[str, list[Any]] = {}
        schemas = {}
        for schema, channel, message in make_reader(io.BytesIO(octets)).iter_messages():
            assert schema is not None
            assert json.loads(schema.data)["type"] == "object"
            schemas[channel.topic] = schema.name
            read.setdefault(channel.topic, []).append(json.loads(message.data))
        assert schemas == {
            "/jackal/commands": "rover.CommandStatus",
            "/jackal/reports": "foxglove.Log",
            "/jackal/tree": "rover.TreeState",
            "/jackal/plans": "rover.PlanProgress",
            "/jackal/alarms": "rover.AlarmStatus",
        }
        logged = read["/jackal/reports"]
        assert [each["report"] for each in logged] == [plain(each) for each in REPORTS]
        assert [each["level"] for each in logged[:3]] == [2, 3, 5]
        assert logged[1]["timestamp"] == {"sec": BEGAN_S, "nsec": 1_000_000}
        assert logged[1]["message"] == "number 1"
        assert read["/jackal/commands"] == [plain(COMMAND)]
        assert read["/jackal/tree"] == [plain(TREE)]
        assert read["/jackal/plans"] == [plain(PLAN)]
        path = "alarms?asset=jackal"
        async with anna.session.get(f"{address}api/{path}") as answer:
            (alarm,) = (await answer.json())["alarms"]
        assert read["/jackal/alarms"] == [{key: alarm[key] for key in alarm if key != "ty"}]

        (line,) = await table(anna, "commands")
        assert line["args"] == '{"distance": 3.0}'
        assert line["started"] == "2096-10-02T07:06:42.000000Z"
        assert line["end"] == "2096-10-02T07:06:45.000000Z"
        assert line["accepted"] == ""
        texts = [each["text"] for each in await table(anna, "reports")]
        assert texts == [each.text for each in REPORTS]
        nodes = await table(anna, "tree")
        assert [(each["mode"], each["name"]) for each in nodes] == [
            ("MOVING", "rover"),
            ("MOVING", "drive"),
        ]
        assert (await table(anna, "plans"))[0]["node"] == "look/drive"
        (alarm,) = await table(anna, "alarms")
        assert (alarm["text"], alarm["raised"][-16:]) == ("hot", "07:06:46.000000Z")
        later = f"reports&start={BEGAN_S + 1}&end={BEGAN_S + 1.0015}"
        assert len(await table(anna, later)) == 2

        what = f"asset=../a&content=tm,plans&format=mcap&start={BEGAN_S}&end={BEGAN_S + 0.5}"
        async with anna.session.get(f"{address}api/export?{what}") as answer:
            named = answer.content_disposition
            assert named is not None
            assert named.filename == ("..-a_telemetry-plans_20961002T070640Z_20961002T070640Z.mcap")
        async with anna.session.get(f"{address}api/export?content=tm,reports") as answer:
            assert answer.status == 422
            assert "a CSV file holds one kind" in (await answer.json())["error"]


async def table(anna: Operator, what: str, asset: str = "jackal") -> list[dict[str, str]]:
    octets = await export(anna, f"asset={asset}&content={what}")
    return list(csv.DictReader(io.StringIO(octets.decode())))
