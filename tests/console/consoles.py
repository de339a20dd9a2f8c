"""A console on a socket, and pages at it, as a browser and a script would be."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from adapters.console.service import ConsoleOptions, running
from adapters.mrs.cli import RoverTarget
from adapters.mrs.transport import CLEAR, TransportSettings
from adapters.system import OPERATING_SYSTEM, System

LIMIT_S = 60.0
ALL = (
    "cmd",
    "ntf",
    "alarm",
    "auth",
    "link",
    "asset",
    "plan",
    "file",
    "presence",
    "dictionary",
    "obj",
)

Said = dict[str, Any]


class Page:
    """A page that is open: what it got, and what it waits for."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self._socket = socket
        self.got: list[Said] = []
        self._looked = 0

    async def until(self, wanted: Callable[[Said], bool]) -> Said:
        """Return the next message that is wanted, of those that were not looked at yet."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                while self._looked < len(self.got):
                    self._looked += 1
                    if wanted(self.got[self._looked - 1]):
                        return self.got[self._looked - 1]
                self.got += await self.batch()

    async def batch(self) -> list[Said]:
        message = await self._socket.receive()
        assert message.type is WSMsgType.TEXT, (message.type, self._socket.close_code)
        batch: list[Said] = json.loads(message.data)
        return batch

    async def command(self, name: str, *states: str) -> Said:
        """Return the command of an id when it is in one of the states."""
        return await self.until(
            lambda said: said["ty"] == "cmd" and said["id"] == name and said["state"] in states
        )

    async def is_up(self, asset: str = "jackal") -> Said:
        return await self.until(
            lambda said: (said["ty"], said.get("asset"), said.get("state")) == ("link", asset, "up")
        )

    async def holds(self, operator: str | None) -> Said:
        return await self.until(lambda said: said["ty"] == "auth" and said["operator"] == operator)

    async def say(self, **said: Any) -> None:
        await self._socket.send_json(said)


class Operator:
    """Somebody at the console."""

    def __init__(self, address: str, name: str, session: ClientSession) -> None:
        self.name = name
        self.address = address
        self.session = session
        self.page: Page

    @asynccontextmanager
    async def open_page(self, *topics: str, **hello: Any) -> AsyncIterator[Page]:
        """Open a page."""
        async with self.session.ws_connect(f"{self.address}ws") as socket:
            page = Page(socket)
            said = {"op": "hello", "console": "test", "operator": self.name} | hello
            await page.say(**said, topics=topics or ALL)
            await page.until(lambda said: said["ty"] == "hello")
            yield page

    async def get(self, path: str, **query: Any) -> Said:
        status, answer = await self.ask("GET", path, params=query)
        assert status == 200, answer
        return answer

    async def ask(self, method: str, path: str, **request: Any) -> tuple[int, Said]:
        url = f"{self.address}{path}"
        async with self.session.request(method, url, **request) as answer:
            if answer.content_type != "application/json":
                return answer.status, {}
            return answer.status, await answer.json()

    async def post(self, path: str, **body: Any) -> tuple[int, Said]:
        return await self.ask("POST", path, json=body)

    async def send(
        self, name: str, command: str, asset: str = "jackal", **args: Any
    ) -> tuple[int, Said]:
        """Post a command under an id."""
        return await self.post("api/commands", id=name, asset=asset, name=command, args=args)

    async def authority(self, act: str, asset: str = "jackal", **more: Any) -> tuple[int, Said]:
        return await self.post(f"api/authority/{asset}", act=act, **more)


@asynccontextmanager
async def served(
    folder: Path,
    *uris: str,
    terms: TransportSettings = CLEAR,
    system: System = OPERATING_SYSTEM,
    **options: Any,
) -> AsyncIterator[str]:
    """Serve a console of rovers at a free port; gives its address."""
    targets = tuple(RoverTarget(uri, terms) for uri in uris)
    at_once = ConsoleOptions(targets, "127.0.0.1", 0, None, None, folder / "console")
    async with running(replace(at_once, **options), system) as address:
        yield address


@asynccontextmanager
async def operator(address: str, name: str, **headers: str) -> AsyncIterator[Operator]:
    """Give somebody at the console who has no page open."""
    async with ClientSession(headers={"X-Rover-Operator": name} | headers) as session:
        yield Operator(address, name, session)


@asynccontextmanager
async def at_console(
    folder: Path,
    uris: str | Iterable[str],
    *names: str,
    topics: Iterable[str] = ALL,
    **options: Any,
) -> AsyncIterator[tuple[Operator, ...]]:
    """Serve a console, with operators who each have a page open."""
    async with AsyncExitStack() as opened:
        all_uris = (uris,) if isinstance(uris, str) else tuple(uris)
        address = await opened.enter_async_context(served(folder, *all_uris, **options))
        found = []
        for name in names:
            somebody = await opened.enter_async_context(operator(address, name))
            somebody.page = await opened.enter_async_context(somebody.open_page(*topics))
            found.append(somebody)
        yield tuple(found)
