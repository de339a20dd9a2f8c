"""Recordings as assets of the console, whose past comes from their files."""

import asyncio
import json
import os
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from threading import Event

import pytest
from aiohttp import web

from adapters.console.archive import Written
from adapters.console.recordings import recordings
from adapters.console.recordings.recorded import RecordedRun
from adapters.console.requests import forks
from adapters.console.rovers import FORMS, command_entries, request_of
from adapters.process import StartError
from adapters.recording import RecordingError, RunFile, RunReader, decode
from executive.commands import Request, argument_values, declaration_of
from executive.settings import load_settings
from tests.console.conftest import record
from tests.console.consoles import LIMIT_S, at_console, operator, served
from tests.support.requests import GOOD

UNREACHABLE = "127.0.0.1:1"
RUN = "jackal@run"


@pytest.mark.parametrize(
    "request_",
    [each for each in GOOD if declaration_of(type(each)).name in FORMS],
    ids=lambda request: type(request).__name__,
)
def test_a_request_is_shown_in_its_posted_form(request_: Request) -> None:
    forms = {each.name: each for each in command_entries(load_settings("jackal"))}
    form = forms[declaration_of(type(request_)).name]
    assert request_of(form, argument_values(request_)) == request_


@pytest.mark.parametrize("request_", GOOD, ids=lambda request: type(request).__name__)
def test_a_request_is_json_also_if_it_is_never_posted(request_: Request) -> None:
    assert json.loads(json.dumps(argument_values(request_))) == argument_values(request_)


async def test_a_recording_is_an_asset_with_the_past_of_its_file(
    drive: Path, tmp_path: Path
) -> None:
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        assets = (await anna.get("api/dictionary"))["assets"]
        assert list(assets) == [RUN]
        recording = assets[RUN]["recording"]
        began = recording["start"]
        assert (recording["file"], recording["rover"]) == ("run.mcap", "jackal")
        assert recording["end"] - began == pytest.approx(6.5)
        assert (bool(assets[RUN]["commands"]), len(assets[RUN]["parameters"])) == (True, 14)

        commands = (await anna.get("api/commands", asset=RUN))["commands"]
        assert [(each["name"], each["args"], each["state"]) for each in commands] == [
            ("takePicture", {}, "executed"),
            ("rotateBy", {"angle": pytest.approx(1.5708, abs=1e-4)}, "executed"),
            ("moveForward", {"distance": 3.0}, "executed"),
        ]
        stages = [each["stage"] for each in commands[-1]["history"]]
        assert stages == ["RECEIVED", "ACCEPTED", "STARTED", "PREDICTED", "EXECUTED"]
        reported = (await anna.get("api/notifications", asset=RUN))["notifications"]
        assert sorted(each["sequence"] for each in reported) == list(range(1, len(reported) + 1))
        assert {each["command"] for each in reported} == {"MOE:1", "MOE:2", "MOE:3"}

        driven = (await anna.get(f"api/tm/{RUN}/POS_X"))["samples"]
        assert driven[-1]["value"] == pytest.approx(3.0, abs=0.1)
        _, before = await anna.post(
            "api/tm:batch", keys=[[RUN, "POS_X"], ["jackal", "POS_X"]], end=began + 2.5
        )
        (sample,) = before["samples"]
        assert (sample["link"], 0.5 < sample["value"] < 2.0) == ("recording", True)


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({}, None),
        ({"set": "drive.travel_speed_mps=0.3"}, "set"),
        ({"set": [0.3]}, "set"),
        ({"command": ["stop"], "at": -1}, "at"),
        ({"controller": "best"}, "controller"),
        ({"world": ["/etc/passwd"]}, "world"),
        ({"command": ["stop\0"]}, None),
        ({"command": ["x" * 200_000]}, None),
        ({"set": ["drive.travel_speed=\ud800"]}, None),
    ],
)
async def test_a_fork_with_an_invalid_body_is_refused(
    drive: Path, tmp_path: Path, body: dict[str, object], field: str | None
) -> None:
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        status, answer = await anna.post(f"api/recordings/{RUN}/fork", **body)
        assert (status, answer.get("field")) == (422, field)


async def test_one_fork_runs_at_a_time_and_ends_in_time(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(forks, "LIMIT_S", 0.05)
    monkeypatch.setattr(forks, "TURN_S", 0.01)
    change = {"set": ["drive.travel_speed_mps=0.3"]}
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        assert (await anna.post("api/recordings/other/fork", **change))[0] == 404
        post = partial(anna.post, f"api/recordings/{RUN}/fork", **change)
        answers = await asyncio.gather(post(), post())
        assert sorted(status for status, _ in answers) == [409, 504]
        assert (await post())[0] == 504, "the former one has ended"
        monkeypatch.setattr(forks, "find_spec", lambda _: None)
        assert (await post())[0] == 501


async def test_a_fork_ends_with_the_connection_of_its_page(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The child process, which would run for minutes, is gone; the next fork has its turn."""
    pid = tmp_path / "pid"
    endless = tmp_path / "endless"
    endless.mkdir()
    (endless / "slow_fork.py").write_text(
        f"import os, time\nopen({str(pid)!r}, 'w').write(str(os.getpid()))\ntime.sleep(300)\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(endless), prepend=os.pathsep)
    monkeypatch.setattr(forks, "FORK", "slow_fork")
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        post = partial(anna.post, f"api/recordings/{RUN}/fork", set=["drive.travel_speed=0.3"])
        answer = asyncio.create_task(post())
        async with asyncio.timeout(LIMIT_S):
            while not (pid.exists() and pid.read_text()):
                await asyncio.sleep(0.01)
            answer.cancel()
            while Path("/proc", pid.read_text()).exists():
                await asyncio.sleep(0.01)
        monkeypatch.setattr(forks, "FORK", "no_such_module")
        assert (await post())[0] == 422


async def test_its_tree_and_why_are_those_of_the_moment(drive: Path, tmp_path: Path) -> None:
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        assets = (await anna.get("api/dictionary"))["assets"]
        at = assets[RUN]["recording"]["start"] + 2.5
        query = {"asset": RUN, "before": at, "limit": 1}
        (tree,) = (await anna.get("api/records/tree", **query))["records"]
        assert (tree["mode"], tree["active"]) == ("MOVING", "MOE:1")
        assert tree["why"].endswith("for MOE:1 moveForward")
        running = [node["name"] for node in tree["nodes"] if node["status"] == "running"]
        assert running[-1] == "drive"
        why = await anna.get(f"api/why/{RUN}/MOE:1")
        assert why["headline"].startswith("MOE:1 moveForward distance 3 m was executed")
        status, answer = await anna.request("GET", f"api/why/{RUN}/MOE:9")
        assert (status, answer["field"]) == (404, "command")


async def test_a_recording_shows_the_pose_uncertainty(tmp_path: Path) -> None:
    recording = record("pose_uncertain", tmp_path)
    async with (
        served(tmp_path, UNREACHABLE, recordings=(recording,)) as address,
        operator(address, "anna") as anna,
    ):
        reported = (await anna.get("api/notifications", asset=RUN))["notifications"]
        events = {each["utc"]: each["text"] for each in reported if "the pose is" in each["text"]}
        for key, maximum in (("EXEC_POSITION_UNCERTAINTY", 0.5), ("EXEC_HEADING_UNCERTAINTY", 0.0)):
            samples = (await anna.get(f"api/tm/{RUN}/{key}"))["samples"]
            assert sorted(each["utc"] for each in samples) == pytest.approx(sorted(events))
            figures = [each["value"] for each in samples]
            assert (max(figures), figures[-1]) == (pytest.approx(maximum, abs=0.01), 0.0)
        assert "certain again, by MOE:6 setPositionCompensation" in events[max(events)]


TOUR = """
title: A plan
duration: 20
timeline:
  - {at: 1, command: {submitPlan: {plan: look-around, id: tour}}, label: plan}
  - {after: plan EXECUTED, command: {activatePlan: {plan_id: tour}}, label: go}
expect:
  - {plan: tour, status: COMPLETED}
"""


async def test_each_command_of_a_plan_has_a_leaf_of_the_plan(tmp_path: Path) -> None:
    scenario = tmp_path / "tour.yaml"
    scenario.write_text(TOUR, encoding="utf-8")
    async with (
        served(tmp_path, UNREACHABLE, recordings=(record(str(scenario), tmp_path),)) as address,
        operator(address, "anna") as anna,
    ):
        commands = (await anna.get("api/commands", asset=RUN))["commands"]
        planned = {f"{each['source']}:{each['number']}" for each in commands} - {"MOE:1", "MOE:2"}
        trees = (await anna.get("api/records/tree", asset=RUN, limit=500))["records"]
        leaves = {
            node["command"]
            for tree in trees
            for node in tree["nodes"]
            if node["path"].startswith("plan:tour/")
        }
        assert leaves - {None} == planned
        assert len(planned) > 2


async def test_a_recording_cannot_be_commanded_nor_stopped(drive: Path, tmp_path: Path) -> None:
    async with (
        served(tmp_path, UNREACHABLE, recordings=(drive,)) as address,
        operator(address, "anna") as anna,
    ):
        for status, answer in (
            await anna.send("one", "moveForward", asset=RUN, distance=1.0),
            await anna.request("POST", f"api/stop/{RUN}"),
        ):
            assert (status, answer["field"]) == (404, "asset")


async def test_a_file_of_a_browser_is_opened_and_closed(drive: Path, tmp_path: Path) -> None:
    async with at_console(tmp_path, UNREACHABLE, "anna") as (anna,):
        for name in (RUN, f"{RUN}-2"):
            status, entry = await anna.request(
                "POST", "api/recordings/run.mcap", data=drive.open("rb")
            )
            assert (status, entry["asset"]) == (201, name)
            message = await anna.page.until(lambda message: message["ty"] == "dictionary")
            assert message["asset"] == name
        assert (await anna.request("DELETE", f"api/recordings/{RUN}"))[0] == 204
        assert list((await anna.get("api/dictionary"))["assets"]) == [f"{RUN}-2"]
        assert (await anna.request("DELETE", f"api/recordings/{RUN}"))[0] == 404
        stored = tmp_path / "console" / "opened"
        assert len(list(stored.iterdir())) == 1
    assert not list(stored.iterdir())


async def test_an_invalid_recording_is_refused_and_not_stored(drive: Path, tmp_path: Path) -> None:
    async with at_console(tmp_path, UNREACHABLE, "anna") as (anna,):
        for content, why in (
            (b"", "run.mcap: contains no run"),
            (b"not at all", "run.mcap: is no MCAP file, or damaged"),
            (drive.read_bytes()[:40], "run.mcap: contains no run"),
        ):
            status, answer = await anna.request("POST", "api/recordings/run.mcap", data=content)
            assert (status, answer["field"]) == (422, "file")
            assert answer["error"].startswith(why)
        assert (await anna.get("api/dictionary"))["assets"] == {}
        assert not list((tmp_path / "console" / "opened").iterdir())
    wrong = tmp_path / "notes.mcap"
    wrong.write_text("not at all")
    with pytest.raises(StartError, match=r"^--recording: .*notes.mcap: is no MCAP file"):
        async with served(tmp_path, UNREACHABLE, recordings=(wrong,)):
            pass


async def test_a_truncated_recording_shows_its_written_part(drive: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.mcap"
    with closing(RunFile(broken)) as file:
        for number, message in enumerate(RunReader(drive).messages()):
            file.put(decode(message.topic, message.data))
            if number % 300 == 0:
                file.flush()
    octets = broken.read_bytes()
    broken.write_bytes(octets[: len(octets) * 3 // 4])
    async with (
        served(tmp_path, UNREACHABLE, recordings=(broken, drive, broken)) as address,
        operator(address, "anna") as anna,
    ):
        assets = (await anna.get("api/dictionary"))["assets"]
        assert list(assets) == ["jackal@broken", RUN]
        assert [each["recording"]["complete"] for each in assets.values()] == [False, True]
        ends = [each["recording"]["end"] for each in assets.values()]
        assert ends[1] - 4.0 < ends[0] < ends[1]


async def test_a_damaged_recording_shows_its_part_before_the_damage(
    drive: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged.mcap"
    with closing(RunFile(damaged)) as file:
        for number, message in enumerate(RunReader(drive).messages()):
            file.put(decode(message.topic, message.data))
            if number % 300 == 0:
                file.flush()
    octets = bytearray(damaged.read_bytes())
    octets[len(octets) // 2] ^= 1
    async with at_console(tmp_path, UNREACHABLE, "anna") as (anna,):
        content = bytes(octets)
        status, entry = await anna.request("POST", "api/recordings/run.mcap", data=content)
        assert (status, entry["asset"]) == (201, RUN)
        assert (entry["recording"]["complete"], entry["recording"]["damaged"]) == (False, True)
        commands = (await anna.get("api/commands", asset=RUN))["commands"]
        assert commands


async def test_reading_ends_when_the_uploader_disconnects(
    drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    requested: list[Callable[[], bool]] = []
    reported: list[str] = []
    is_connected = recordings.is_connected
    read = RecordedRun.messages
    reads, has_left = Event(), Event()

    def wanted(request: web.Request) -> Callable[[], bool]:
        requested.append(is_connected(request))
        return requested[-1]

    def slowly(run: RecordedRun, name: str) -> Iterator[Written]:
        reads.set()
        assert has_left.wait(LIMIT_S)
        try:
            yield from read(run, name)
        except RecordingError as error:
            reported.append(str(error))
            raise

    monkeypatch.setattr(RecordedRun, "messages", slowly)
    monkeypatch.setattr(f"{recordings.__name__}.is_connected", wanted)
    stored = tmp_path / "console" / "opened"
    async with at_console(tmp_path, UNREACHABLE, "anna") as (anna,), asyncio.timeout(LIMIT_S):
        content = drive.read_bytes()
        post = asyncio.create_task(anna.request("POST", "api/recordings/run.mcap", data=content))
        await asyncio.to_thread(reads.wait, LIMIT_S)
        post.cancel()
        while requested[0]():
            await asyncio.sleep(0)
        has_left.set()
        while list(stored.iterdir()):
            await asyncio.sleep(0)
        assert [each.endswith("reading was cancelled") for each in reported] == [True]
        assert (await anna.get("api/dictionary"))["assets"] == {}
