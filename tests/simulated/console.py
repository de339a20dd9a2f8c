"""`rover-console` in a simulated world, and a page of it in a browser behind an `ssh -L` tunnel."""

import asyncio
import json
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

import aiohttp
from aiohttp.abc import AbstractResolver, ResolveResult

from adapters.console.service import ConsoleOptions, serve
from adapters.mrs.cli import RoverTarget
from adapters.mrs.transport import CLEAR
from adapters.process import StartError
from executive.commands import Request, Stop, argument_values, declaration_of
from executive.values.reports import Identity
from tests.simulated.process import Process
from tests.simulated.processes import MRS_PORT, Address
from tests.simulated.system import SimSystem

OPERATOR: Final = "CAPCOM"
HOST: Final = "10.0.1.6"
BROWSER_HOST: Final = "10.0.1.7"
PORT: Final = 8400
TOPICS: Final = ("tm", "cmd", "auth", "link", "asset", "presence", "dictionary", "alarm", "ntf")
_BASE: Final = f"http://localhost:{PORT}"
_FIRST_RETRY_S, _MAX_RETRY_S = 0.3, 5.0
_SILENCE_S, _ANSWER_S = 10.0, 5.0
_STOP_RETRIES, _STOP_RETRY_S = 5, 0.4
_LINKS: Final = (None, None, "direct", "relay")


def start_console(address: Address, process: Process) -> None:
    """Start `rover-console`, with the direct link and the relay's to a rover."""
    hosts = (address.executive, address.orbiter)
    rovers = tuple(RoverTarget(f"maltcp://{host}:{MRS_PORT}/MRS", CLEAR) for host in hosts)
    options = ConsoleOptions(rovers, "127.0.0.1", PORT, tokens=None, tls=None, data=process.folder)

    async def begin() -> None:
        try:
            await serve(options, SimSystem(process))
        except StartError as error:
            raise SystemExit(1) from error

    process.run(begin())


@dataclass
class PageJournal:
    """What an operator requested of a console, and received; it outlasts kills of the browser.

    Attributes:
        posted: ids of commands, with the times at which they were posted first.
        requests: what they ask for.
        answers: the statuses of HTTP to each id, in their order; 0 for none.
        acknowledged: what was answered to those that were accepted, which are to be in the archive.
        stops: those that the console took, with the times.
        ends: their states at the end, as the page received them.
        states: the last state of each command that the page received.
    """

    posted: dict[str, float] = field(default_factory=dict)
    requests: dict[str, Request] = field(default_factory=dict)
    answers: dict[str, list[int]] = field(default_factory=dict)
    acknowledged: dict[str, Identity] = field(default_factory=dict)
    stops: dict[Identity, float] = field(default_factory=dict)
    ends: dict[Identity, list[str]] = field(default_factory=dict)
    states: dict[Identity, str] = field(default_factory=dict)


class Browser:
    """A page of a console: a WebSocket that comes back, and requests, as `connection.js` has them.

    Args:
        asset: which it commands.
        journal: takes what its operator comes to know.
    """

    def __init__(self, asset: str, journal: PageJournal) -> None:
        self._asset, self.journal = asset, journal
        self._process: Process | None = None
        self._session: aiohttp.ClientSession

    def start(self, process: Process) -> None:
        """Open the page; the `start` of a process."""
        self._process = process
        process.run(self._serve(process))

    def send(self, request: Request, number: int) -> None:
        """Post a command, or the same again; an event of the world."""
        process = self._process
        if process is not None and process.alive:
            loop = process.loop
            loop.call_soon(lambda: loop.create_task(self._send(request, number)))

    async def _serve(self, process: Process) -> None:

        def unconnected(_: object) -> Any:
            return process.world.network.unconnected(process.present)

        connector = aiohttp.TCPConnector(  # the cache is in real time
            socket_factory=unconnected, resolver=_Tunnel(), use_dns_cache=False
        )
        self._instance, self._seq = "", 0
        self._chance = process.world.random(f"page/{process.name}")
        headers = {"X-Rover-Operator": OPERATOR, "Origin": _BASE}
        async with aiohttp.ClientSession(_BASE, connector=connector, headers=headers) as session:
            self._session = session
            wait_s = _FIRST_RETRY_S
            while True:
                with suppress(aiohttp.ClientError, OSError, TimeoutError):
                    async with session.ws_connect("/ws", max_msg_size=0) as socket:
                        wait_s = _FIRST_RETRY_S
                        await self._listen(socket)
                await asyncio.sleep(wait_s * self._chance.uniform(0.7, 1.3))
                wait_s = min(1.7 * wait_s, _MAX_RETRY_S)

    async def _listen(self, socket: "aiohttp.ClientWebSocketResponse[bool]") -> None:
        resume = {"instance": self._instance, "seq": self._seq}
        hello = {"op": "hello", "console": "page", "operator": OPERATOR, "topics": TOPICS}
        await socket.send_json(hello | {"resume": resume})
        while True:
            message = await socket.receive(_SILENCE_S)
            if message.type is not aiohttp.WSMsgType.TEXT:
                return
            for reported in json.loads(message.data):
                await self._receive(reported)

    async def _receive(self, reported: dict[str, Any]) -> None:
        self._seq = reported.get("seq", self._seq)
        match reported["ty"]:
            case "hello":
                if not reported["resumed"]:
                    self._seq = reported["seq"]
                    await self._request("GET", "/api/dictionary")
                    await self._request("GET", f"/api/notifications?asset={self._asset}&limit=500")
                self._instance = reported["instance"]
            case "cmd":
                identity = Identity(reported["source"], reported["number"])
                self.journal.states[identity] = reported["state"]
                if reported["ended"]:
                    ends = self.journal.ends.setdefault(identity, [])
                    ends += [reported["state"]] if reported["state"] not in ends else []
            case _:
                pass

    async def _send(self, request: Request, number: int) -> None:
        now_s, name = asyncio.get_running_loop().time(), f"page-{number}"
        self.journal.posted.setdefault(name, now_s)
        self.journal.requests[name] = request
        answers = self.journal.answers.setdefault(name, [])
        if isinstance(request, Stop):
            answers.append(await self._stop())
            return
        posted = {
            "id": name,
            "asset": self._asset,
            "name": declaration_of(type(request)).name,
            "args": argument_values(request),
            "link": _LINKS[number % len(_LINKS)],
        }
        try:
            status, body = await self._request("POST", "/api/commands", posted)
        except (aiohttp.ClientError, OSError, TimeoutError):
            status, body = 0, {}
        answers.append(status)
        found = body.get("command") if status == HTTPStatus.CONFLICT else body
        if found and status in {HTTPStatus.ACCEPTED, HTTPStatus.CONFLICT}:
            self.journal.acknowledged[name] = Identity(found["source"], found["number"])
        with suppress(aiohttp.ClientError, OSError, TimeoutError):
            await self._request("GET", f"/api/commands?asset={self._asset}&limit=20")

    async def _stop(self) -> int:
        """Stop, and again while the console cannot be reached; return the last status."""
        for _ in range(_STOP_RETRIES):
            try:
                status, body = await self._request("POST", f"/api/stop/{self._asset}", {})
            except (aiohttp.ClientError, OSError, TimeoutError):
                await asyncio.sleep(_STOP_RETRY_S)
                continue
            if status == HTTPStatus.ACCEPTED:
                now_s = asyncio.get_running_loop().time()
                self.journal.stops[Identity(body["source"], body["number"])] = now_s
            return status
        return 0

    async def _request(
        self, method: str, path: str, body: dict[str, Any] | None = None
    ) -> tuple[int, dict[str, Any]]:
        timeout = aiohttp.ClientTimeout(_ANSWER_S)
        async with self._session.request(method, path, json=body, timeout=timeout) as answer:
            return answer.status, json.loads(await answer.text() or "{}")


class _Tunnel(AbstractResolver):
    """Has this computer's port lead to the console's, as `ssh -L` does."""

    async def resolve(self, host: str, port: int = 0, family: Any = 0) -> list[ResolveResult]:
        found = {"hostname": host, "host": HOST, "port": port, "family": family}
        return [ResolveResult(**found, proto=0, flags=0)]  # type: ignore[typeddict-item]

    async def close(self) -> None:
        """Nothing is open."""
