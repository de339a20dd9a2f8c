"""A console on a socket, and pages at it, as a browser and a script would be."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, ClientWebSocketResponse, WSMessage, WSMsgType

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
    "stop",
    "link",
    "asset",
    "plan",
    "file",
    "presence",
    "dictionary",
    "obj",
)

JsonMessage = dict[str, Any]


class Page:
    """A page that is open: what it got, and what it waits for."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self._socket = socket
        self._received: asyncio.Queue[WSMessage] = asyncio.Queue()
        self.got: list[JsonMessage] = []
        self._checked = 0

    async def until(self, wanted: Callable[[JsonMessage], bool]) -> JsonMessage:
        """Return the next message that is wanted, of those that were not looked at yet."""
        async with asyncio.timeout(LIMIT_S):
            while True:
                while self._checked < len(self.got):
                    self._checked += 1
                    if wanted(self.got[self._checked - 1]):
                        return self.got[self._checked - 1]
                self.got += await self.batch()

    async def receive(self) -> None:
        """Receive until the console closes the socket: it closes those that do not answer pings."""
        while not self._socket.closed:
            self._received.put_nowait(await self._socket.receive())

    async def batch(self) -> list[JsonMessage]:
        message = await self._received.get()
        assert message.type is WSMsgType.TEXT, (message.type, self._socket.close_code)
        batch: list[JsonMessage] = json.loads(message.data)
        return batch

    async def command(self, name: str, *states: str) -> JsonMessage:
        """Return the command of an id when it is in one of the states."""
        return await self.until(
            lambda text: text["ty"] == "cmd" and text["id"] == name and text["state"] in states
        )

    async def is_up(self, asset: str = "jackal") -> JsonMessage:
        return await self.until(
            lambda text: (text["ty"], text.get("asset"), text.get("state")) == ("link", asset, "up")
        )

    async def holds(self, operator: str | None) -> JsonMessage:
        return await self.until(lambda text: text["ty"] == "auth" and text["operator"] == operator)

    async def send(self, **text: Any) -> None:
        await self._socket.send_json(text)


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
            receiving = asyncio.create_task(page.receive())
            text = {"op": "hello", "console": "test", "operator": self.name} | hello
            try:
                await page.send(**text, topics=topics or ALL)
                await page.until(lambda text: text["ty"] == "hello")
                yield page
            finally:
                receiving.cancel()

    async def get(self, path: str, **query: Any) -> JsonMessage:
        status, answer = await self.request("GET", path, params=query)
        assert status == 200, answer
        return answer

    async def request(self, method: str, path: str, **request: Any) -> tuple[int, JsonMessage]:
        url = f"{self.address}{path}"
        async with self.session.request(method, url, **request) as answer:
            if answer.content_type != "application/json":
                return answer.status, {}
            return answer.status, await answer.json()

    async def post(self, path: str, **body: Any) -> tuple[int, JsonMessage]:
        return await self.request("POST", path, json=body)

    async def send(
        self, name: str, command: str, asset: str = "jackal", **args: Any
    ) -> tuple[int, JsonMessage]:
        """Post a command under an id."""
        return await self.post("api/commands", id=name, asset=asset, name=command, args=args)

    async def authority(
        self, act: str, asset: str = "jackal", **more: Any
    ) -> tuple[int, JsonMessage]:
        return await self.post(f"api/authority/{asset}", action=act, **more)


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
            one_operator = await opened.enter_async_context(operator(address, name))
            one_operator.page = await opened.enter_async_context(one_operator.open_page(*topics))
            found.append(one_operator)
        yield tuple(found)
