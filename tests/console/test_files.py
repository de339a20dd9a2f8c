"""Files of a rover, listed and fetched; over links that are lost, by consoles that are killed."""

import asyncio
import random
import signal
from itertools import chain, repeat
from pathlib import Path

import pytest

from adapters.console.requests import file_store, transfers
from adapters.mrs.ground import MrsClient, TransferError
from tests.console.conftest import Launch, record
from tests.console.consoles import JsonMessage, Operator, at_console, operator
from tests.mrs.test_file_retrieval import cutting
from tests.support.processes import running

PICTURE = b"\xff\xd8" + bytes(range(256)) * 300
OCTETS = random.Random(7).randbytes(3_000_000)


async def fetch(anna: Operator, path: str) -> tuple[int, bytes, dict[str, str]]:
    async with anna.session.get(f"{anna.address}api/files/jackal/{path}") as answer:
        return answer.status, await answer.read(), dict(answer.headers)


async def test_files_are_listed_and_fetched_once(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    rover.put("pictures/rock one.jpg", PICTURE)
    rover.put("page.html", b"<script>alert(1)</script>")
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        found = {each["path"]: each for each in (await anna.get("api/files/jackal"))["files"]}
        assert found["pictures/rock one.jpg"]["size"] == len(PICTURE)
        assert found["pictures/rock one.jpg"]["mime"] == "image/jpeg"
        both = await asyncio.gather(*(fetch(anna, "pictures/rock%20one.jpg") for _ in range(2)))
        for status, octets, headers in both:
            assert (status, octets) == (200, PICTURE)
            assert headers["Content-Type"] == "image/jpeg"
            assert headers["Content-Disposition"].startswith("inline")
        status, octets, headers = await fetch(anna, "page.html")
        assert (status, headers["Content-Type"]) == (200, "application/octet-stream")
        assert headers["Content-Disposition"].startswith("attachment")
        assert "sandbox" in headers["Content-Security-Policy"]
        assert (await fetch(anna, "none.jpg"))[0] == 404
        assert (await fetch(anna, "..%2f..%2fsecret"))[0] in {404, 422}
        stored = (await anna.get("api/files/rover-console"))["files"]
        assert [each["path"] for each in stored] == [
            "jackal/page.html",
            "jackal/pictures/rock one.jpg",
        ]
        assert len((await anna.get("api/transfers"))["transfers"]) == 2
        await fetch(anna, "pictures/rock%20one.jpg")
        assert len((await anna.get("api/transfers"))["transfers"]) == 2
        rover.put("pictures/rock one.jpg", PICTURE[::-1])
        assert (await fetch(anna, "pictures/rock%20one.jpg"))[1] == PICTURE[::-1]


async def test_the_files_fetched_first_are_deleted_first(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = launch()
    for number in range(4):
        rover.put(f"{number}.bin", bytes([number]) * 1000)
    monkeypatch.setattr(file_store, "MAX_OCTETS", 2500)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        for number in range(4):
            assert (await fetch(anna, f"{number}.bin"))[1] == bytes([number]) * 1000
        stored = (await anna.get("api/files/rover-console"))["files"]
        assert [each["path"] for each in stored] == ["jackal/2.bin", "jackal/3.bin"]


async def transfer(anna: Operator, path: str, asset: str = "jackal") -> tuple[int, JsonMessage]:
    return await anna.request("POST", "api/transfers", json={"asset": asset, "path": path})


async def stopped(anna: Operator, name: str, state: str) -> list[JsonMessage]:
    """Return all that is told of a transfer until it is in a state."""
    reported: list[JsonMessage] = []
    while not reported or reported[-1]["state"] != state:
        reported.append(await anna.page.until(lambda message: message.get("id") == name))
    return reported


async def test_a_transfer_continues_after_a_lost_link(launch: Launch, tmp_path: Path) -> None:
    rover = launch()
    rover.put("rock.raw", OCTETS)
    async with (
        cutting(rover.uri, chain([None, 1_000_000], repeat(None))) as (address, proxy),
        at_console(tmp_path, address, "anna", "bert", topics=["link", "transfer"]) as (anna, bert),
    ):
        await anna.page.is_up()
        status, begun = await transfer(anna, "rock.raw")
        assert (status, begun["by"], begun["state"]) == (202, "anna", "waiting")
        reported = await stopped(anna, begun["id"], "done")
        assert "interrupted" in [each["state"] for each in reported]
        assert [each["done"] for each in reported] == sorted(each["done"] for each in reported)
        assert (reported[-1]["done"], reported[-1]["size"], proxy.cuts) == (
            len(OCTETS),
            len(OCTETS),
            1,
        )
        assert (await stopped(bert, begun["id"], "done"))[-1] == reported[-1]
        assert (tmp_path / "console/files/jackal/rock.raw").read_bytes() == OCTETS


async def test_a_transfer_continues_after_the_console_was_killed(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    rover.put("rock.raw", OCTETS)
    links = chain([None, 1_000_000, None], repeat(2_200_000))
    async with cutting(rover.uri, links) as (address, proxy):
        arguments = ("--to", address, "--port", "0", "--data", str(tmp_path / "data"))
        for run in (1, 2):
            log = tmp_path / f"console-{run}.log"
            with running(log, "rover-console", *arguments) as process:
                served = await asyncio.to_thread(process.output, r"(http://127.0.0.1:\d+/)")
                async with (
                    operator(served, "anna") as anna,
                    anna.open_page("link", "transfer") as anna.page,
                ):
                    await anna.page.is_up()
                    if run == 1:
                        await transfer(anna, "rock.raw")
                    (known,) = (await anna.get("api/transfers"))["transfers"]
                    await stopped(anna, known["id"], "interrupted" if run == 1 else "done")
                process.end(signal.SIGKILL)
        assert proxy.cuts == 1, "the rest alone fits into what the last connection may carry"
    assert (tmp_path / "data/files/jackal/rock.raw").read_bytes() == OCTETS


async def test_a_file_changed_aboard_during_its_transfer_restarts(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    rover.put("rock.raw", OCTETS)
    async with (
        cutting(rover.uri, chain([None, 1_000_000, 0], repeat(None))) as (address, _),
        at_console(tmp_path, address, "anna", topics=["link", "transfer"]) as (anna,),
    ):
        await anna.page.is_up()
        _, begun = await transfer(anna, "rock.raw")
        await stopped(anna, begun["id"], "interrupted")
        rover.put("rock.raw", OCTETS[::-1])
        await stopped(anna, begun["id"], "done")
    files = tmp_path / "console/files"
    assert (files / "jackal/rock.raw").read_bytes() == OCTETS[::-1]
    assert [each.name for each in (files / ".transfers").iterdir()] == ["list.json"]


async def test_a_file_that_never_matches_is_not_requested_without_end(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def retrieve(*_: object) -> None:
        raise TransferError("rock.raw was changed aboard: fetch it again")

    monkeypatch.setattr(transfers, "RETRY_S", 0.01)
    monkeypatch.setattr(MrsClient, "retrieve_file", retrieve)
    rover = launch()
    rover.put("rock.raw", OCTETS)
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "transfer"]) as (anna,):
        await anna.page.is_up()
        _, begun = await transfer(anna, "rock.raw")
        failed = (await stopped(anna, begun["id"], "failed"))[-1]
        assert "was changed aboard" in failed["detail"]


async def test_a_bounded_number_of_transfers_run_at_once_and_others_wait(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transfers, "MAX_ACTIVE", 1)
    rover = launch()
    for number in range(3):
        rover.put(f"{number}.raw", OCTETS[number:])
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "transfer"]) as (anna,):
        await anna.page.is_up()
        for number in range(3):
            await transfer(anna, f"{number}.raw")
        states: dict[str, str] = {}
        while list(states.values()) != ["done"] * 3:
            message = await anna.page.until(lambda message: message["ty"] == "transfer")
            states[message["path"]] = message["state"]
            assert list(states.values()).count("running") <= 1


async def test_an_unavailable_file_gives_the_reason_and_is_removed_from_the_list(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "transfer"]) as (anna,):
        await anna.page.is_up()
        _, begun = await transfer(anna, "none.raw")
        failed = (await stopped(anna, begun["id"], "failed"))[-1]
        assert "none.raw" in failed["detail"]
        assert (await anna.request("DELETE", f"api/transfers/{begun['id']}"))[0] == 204
        await stopped(anna, begun["id"], "removed")
        assert (await anna.request("DELETE", f"api/transfers/{begun['id']}"))[0] == 404
        for path, status in (("../secret", 422), ("a" * 300, 422)):
            assert (await transfer(anna, path))[0] == status
        assert (await transfer(anna, "a", "nobody"))[0] == 404


async def test_a_transfer_that_was_paused_waits_to_be_resumed(
    launch: Launch, tmp_path: Path
) -> None:
    rover = launch()
    rover.put("rock.raw", OCTETS)
    async with (
        cutting(rover.uri, chain([None, 1_000_000], repeat(2_200_000))) as (address, proxy),
        at_console(tmp_path, address, "anna", topics=["link", "transfer"]) as (anna,),
    ):
        await anna.page.is_up()
        _, begun = await transfer(anna, "rock.raw")
        act = f"api/transfers/{begun['id']}"
        await stopped(anna, begun["id"], "interrupted")
        status, paused = await anna.post(act, action="pause")
        assert (status, paused["state"]) == (200, "paused")
        assert (await anna.post(act, action="pause"))[1]["state"] == "paused"
        assert (await transfer(anna, "rock.raw"))[1] == paused
        assert (await anna.post(act, action="resume"))[1]["state"] == "waiting"
        await stopped(anna, begun["id"], "done")
        assert (await anna.post(act, action="resume"))[1]["state"] == "done"
        assert (await anna.post(act, action="stop"))[0] == 422
        assert (await anna.post("api/transfers/none", action="pause"))[0] == 404
        assert (await anna.post(f"{act}/recording"))[0] == 422
        assert proxy.cuts == 1, "the rest alone fits into what the last connection may carry"
    assert (tmp_path / "console/files/jackal/rock.raw").read_bytes() == OCTETS


async def test_a_recording_that_was_changed_since_is_opened_as_it_is_now(
    launch: Launch, drive: Path, tmp_path: Path
) -> None:
    rover, turn = launch(), record("motion_turn", tmp_path)
    opened = []
    async with at_console(tmp_path, rover.uri, "anna", topics=["link", "transfer"]) as (anna,):
        await anna.page.is_up()
        for run in (drive, turn):
            rover.put("runs/run.mcap", run.read_bytes())
            for _ in range(2):
                _, begun = await transfer(anna, "runs/run.mcap")
                await stopped(anna, begun["id"], "done")
                status, entry = await anna.post(f"api/transfers/{begun['id']}/recording")
                assert (status, entry["asset"]) == (201, "jackal@run")
                opened.append(entry["recording"])
        assets = (await anna.get("api/dictionary"))["assets"]
    assert opened[0] == opened[1] != opened[2] == opened[3] == assets["jackal@run"]["recording"]


async def test_the_current_recording_is_fetched_and_opened(
    launch: Launch, drive: Path, tmp_path: Path
) -> None:
    """Each request opens the recording of that time."""
    growing = tmp_path / "aboard" / "20261130T060000Z.mcap"
    growing.parent.mkdir()
    rover, silent = launch(recordings=growing.parent), launch("silent")
    path, spans = "api/files/jackal/recording", []
    uris = (rover.uri, silent.uri)
    async with at_console(tmp_path, uris, "anna", topics=["link"]) as (anna,):
        for _ in uris:
            await anna.page.until(lambda message: message.get("state") == "up")
        status, answer = await anna.post("api/files/silent/recording")
        assert (status, "recording.enabled" in answer["error"]) == (404, True)
        status, answer = await anna.post(path)
        assert (status, "there is no recording yet" in answer["error"]) == (422, True)
        for run in (drive, record("motion_turn", tmp_path)):
            growing.write_bytes(run.read_bytes())
            rover.put("current-recording/moved.txt", b"")
            status, entry = await anna.post(path)
            assert (status, entry.get("asset")) == (201, "jackal@20261130T060000Z"), entry
            spans.append(entry["recording"]["end"] - entry["recording"]["start"])
        rover.hang_up()
        await anna.page.until(lambda message: message.get("state") == "down")
        assert "cannot be reached" in (await anna.post(path))[1]["error"]
    assert spans[0] != spans[1]
