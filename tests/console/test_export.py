"""Telemetry of the archive for other programs."""

import io
import json
from pathlib import Path

from mcap.reader import make_reader

from adapters.console.archive import Archive, open_database
from adapters.console.messages import Link, Quality, Sample
from tests.console.consoles import Operator, operator, served

NOBODY = "127.0.0.1:1"
BEGAN_S = 4_000_000_000
"""Nothing of it is too old to be kept."""
COUNT = 25_000
"""More than are read at once."""


async def fill(folder: Path) -> None:
    folder.mkdir()
    archive = Archive(open_database(None, folder))
    for number in range(COUNT):
        at_s, value = float(BEGAN_S + number), float(number)
        archive.put(Sample("jackal", "POS_X", Link.DIRECT, at_s, at_s + 1, value, Quality.GOOD))
    archive.put(Sample("scout", "HEAD", Link.RELAY, BEGAN_S, BEGAN_S, None, Quality.INVALID))
    await archive.close()


async def export(anna: Operator, query: str) -> bytes:
    async with anna.session.get(f"{anna.address}api/export?{query}") as answer:
        assert answer.status == 200
        return await answer.read()


async def test_telemetry_is_exported_whole(tmp_path: Path) -> None:
    await fill(tmp_path / "console")
    async with served(tmp_path, NOBODY) as address, operator(address, "anna") as anna:
        header, *lines = (await export(anna, "asset=jackal")).decode().splitlines()
        assert header == "utc,rx,asset,link,key,value,quality"
        assert lines[1] == f"{BEGAN_S + 1}.0,{BEGAN_S + 2}.0,jackal,direct,POS_X,1.0,good"
        assert [float(line.split(",")[5]) for line in lines] == list(range(COUNT))

        part = io.BytesIO(await export(anna, f"fmt=mcap&start={BEGAN_S + 7}&end={BEGAN_S + 8}"))
        messages = [message for _, _, message in make_reader(part).iter_messages()]
        assert [json.loads(message.data) for message in messages] == [
            {"value": 7.0, "quality": "good"},
            {"value": 8.0, "quality": "good"},
        ]
        assert messages[0].publish_time == (BEGAN_S + 7) * 10**9
        assert messages[0].log_time == (BEGAN_S + 8) * 10**9

        whole = make_reader(io.BytesIO(await export(anna, "fmt=mcap"))).get_summary()
        assert whole is not None
        assert whole.statistics is not None
        counts = whole.statistics.channel_message_counts
        found = {channel.topic: counts[number] for number, channel in whole.channels.items()}
        rovers = {topic: count for topic, count in found.items() if "console" not in topic}
        assert rovers == {"/jackal/direct/POS_X": COUNT, "/scout/relay/HEAD": 1}
