"""Consoles with one archive show each other's operators, as long as they are there."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from adapters.console.archive import Archive, open_database
from adapters.console.messages import Presence
from adapters.console.web import PRESENCE_TIMEOUT_S, Hub, SharedPresence
from adapters.system import OPERATING_SYSTEM
from tests.console.conftest import Launch
from tests.console.consoles import at_console
from tests.console.postgres import fresh


class Console:
    """One of several."""

    def __init__(self, archive: Archive) -> None:
        self.now_s = 0.0
        self.hub = Hub(OPERATING_SYSTEM)
        self.presence = SharedPresence(archive, self.hub, lambda: self.now_s)

    @property
    def shown(self) -> list[str]:
        """Whose pages are told of."""
        reported = [each for each in self.hub.latest_messages() if isinstance(each, Presence)]
        return [page.operator for each in reported for page in each.consoles]


@asynccontextmanager
async def two(folder: Path) -> AsyncIterator[tuple[Console, Console]]:
    archive = Archive(open_database(None, folder), OPERATING_SYSTEM.utc_s)
    yield Console(archive), Console(archive)
    await archive.close()


async def test_each_shows_the_pages_of_both_until_they_are_closed(tmp_path: Path) -> None:
    async with two(tmp_path) as (one, other):
        page = one.hub.open("A", "anna")
        await one.presence.exchange()
        await other.presence.exchange()
        assert (one.shown, other.shown) == (["anna"], ["anna"])
        other.hub.open("B", "ben")
        for each in (other, one):
            await each.presence.exchange()
        assert (one.shown, other.shown) == (["anna", "ben"], ["ben", "anna"])
        one.hub.close(page)
        for each in (one, other):
            await each.presence.exchange()
        assert (one.shown, other.shown) == (["ben"], ["ben"])


async def test_a_console_that_was_killed_is_not_shown_for_long(tmp_path: Path) -> None:
    async with two(tmp_path) as (killed, other):
        killed.hub.open("A", "anna")
        await killed.presence.exchange()
        for since_s in (0.0, PRESENCE_TIMEOUT_S):
            other.now_s = since_s
            await other.presence.exchange()
            assert other.shown == ["anna"]
        other.now_s = PRESENCE_TIMEOUT_S + 0.1
        await other.presence.exchange()
        assert other.shown == []
        await killed.presence.exchange()  # it only stood still
        await other.presence.exchange()
        assert other.shown == ["anna"]


async def test_operators_at_one_postgresql_see_each_other(
    launch: Launch, postgres: str, tmp_path: Path
) -> None:
    rover, url = launch(), fresh(postgres)
    async with at_console(tmp_path / "one", rover.uri, "anna", archive=url) as (anna,):

        async def shown(*operators: str) -> None:
            await anna.page.until(
                lambda message: (
                    message["ty"] == "presence"
                    and [each["operator"] for each in message["consoles"]] == list(operators)
                )
            )

        async with at_console(tmp_path / "two", rover.uri, "ben", archive=url):
            await shown("anna", "ben")
        await shown("anna")
