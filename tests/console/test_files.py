"""Files of a rover, listed and fetched by a page."""

import asyncio
from pathlib import Path

import pytest

from adapters.console.requests import files
from tests.console.conftest import Launch
from tests.console.consoles import Operator, at_console

PICTURE = b"\xff\xd8" + bytes(range(256)) * 300


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
        kept = list((tmp_path / "console" / "fetched").iterdir())
        assert len(kept) == 2
        await fetch(anna, "pictures/rock%20one.jpg")
        assert len(list((tmp_path / "console" / "fetched").iterdir())) == 2


async def test_what_was_fetched_longest_ago_is_forgotten(
    launch: Launch, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rover = launch()
    for number in range(4):
        rover.put(f"{number}.bin", bytes([number]) * 1000)
    monkeypatch.setattr(files, "MOST_KEPT", 2500)
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        for number in range(4):
            assert (await fetch(anna, f"{number}.bin"))[1] == bytes([number]) * 1000
    assert len(list((tmp_path / "console" / "fetched").iterdir())) == 2
