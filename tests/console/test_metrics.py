"""The metrics of a console: its links, its pages, and who may read them."""

from pathlib import Path

import pytest
from aiohttp import ClientSession

from adapters.metrics import exposition
from tests.console.consoles import Operator, at_console, operator, served
from tests.mrs.aboard import Aboard
from tests.support.metrics import Page, check_documented

UNREACHABLE = "127.0.0.1:1"
TOKENS = "anna 0123456789abcdef\n"


async def read(client: Operator) -> Page:
    async with client.session.get(f"{client.address}metrics") as answer:
        assert (answer.status, answer.content_type) == (200, "text/plain")
        return Page(await answer.text())


async def test_links_are_shown(
    rover: Aboard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exposition, "MIN_AGE_S", 0.0)
    link = {"asset": "jackal", "link": "direct"}
    async with at_console(tmp_path, rover.uri, "anna") as (anna,):
        await anna.page.is_up()
        page = await read(anna)
        page.check_names()
        check_documented(page, "console")
        assert page.value("rover_console_link_up", **link) == 1.0
        assert page.value("rover_console_pages") is not None
        assert page.value("rover_build_info", component="console") == 1.0


async def test_metrics_need_the_token_of_an_operator(tmp_path: Path) -> None:
    tokens = tmp_path / "tokens"
    tokens.write_text(TOKENS)
    async with served(tmp_path, UNREACHABLE, tokens=tokens) as address:
        async with ClientSession() as stranger, stranger.get(f"{address}metrics") as answer:
            assert answer.status == 401
        proof = {"Authorization": "Bearer 0123456789abcdef"}
        async with operator(address, "anna", **proof) as anna:
            assert (await read(anna)).value("rover_build_info") == 1.0
            foreign = {"Origin": "http://evil.example"}
            assert (await anna.request("GET", "metrics", headers=foreign))[0] == 403
