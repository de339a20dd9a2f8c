"""`Sockets` serves the WebSocket `/ws`: subscriptions of a page, and the batches sent to it."""

import asyncio
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from aiohttp import WSCloseCode, WSMsgType, web

from adapters.console.messages import encode
from adapters.console.web.access import OPERATOR, Access
from adapters.console.web.hub import Hub, PageConnection
from adapters.console.web.responses import read_json
from executive.commands.intake import is_valid_source

HEARTBEAT_S: Final = 20.0
HELLO_S: Final = 10.0
MAX_MESSAGE_OCTETS: Final = 1 << 16
MAX_TOPICS: Final = 1000
MAX_NAME_LENGTH: Final = 64


class _InvalidMessageError(ValueError):
    """A message of a page is invalid; the text is sent to the page."""


@dataclass(frozen=True, slots=True)
class _Hello:
    console: str
    operator: str | None
    topics: tuple[str, ...]
    instance: object
    seq: object


class Sockets:
    """Serves `/ws`.

    Args:
        hub: sends messages to the pages.
        access: whether tokens identify the operators.
    """

    def __init__(self, hub: Hub, access: Access) -> None:
        self._hub = hub
        self._access = access
        self._open: set[web.WebSocketResponse] = set()

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """Serve a page until it disconnects."""
        socket = web.WebSocketResponse(
            heartbeat=HEARTBEAT_S, compress=False, max_msg_size=MAX_MESSAGE_OCTETS
        )
        try:
            await socket.prepare(request)
        except ValueError as error:  # Sec-WebSocket-Key is not ASCII
            raise web.HTTPBadRequest from error
        self._open.add(socket)
        page = sending = None
        try:
            hello = _hello(await _receive(socket, HELLO_S))
            operator = request[OPERATOR]
            if hello.operator is not None and not self._access.named:
                operator = hello.operator
            page = self._hub.open(hello.console, operator)
            resumed = self._hub.can_resume(hello.instance, hello.seq)
            await socket.send_str(f"[{encode(self._hub.hello(page, resumed=resumed))}]")
            if resumed and isinstance(hello.seq, int):
                page.resume(hello.topics, hello.seq)
            else:
                page.subscribe(hello.topics)
            sending = asyncio.create_task(_send(socket, page))
            while True:
                page.subscribe(_topics(await _receive(socket)))
        except _InvalidMessageError as error:
            await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=str(error).encode()[:120])
        except (ConnectionError, TimeoutError):
            await socket.close()
        finally:
            self._open.discard(socket)
            if sending is not None:
                sending.cancel()
            if page is not None:
                self._hub.close(page)
        return socket

    async def close(self, _: web.Application) -> None:
        """Disconnect all pages; they reconnect after a restart of the console."""
        for socket in tuple(self._open):
            await socket.close(code=WSCloseCode.GOING_AWAY)


async def _send(socket: web.WebSocketResponse, page: PageConnection) -> None:
    with suppress(ConnectionError):
        while not page.too_slow:
            await socket.send_str(await page.batch())
        await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"too slow: resume")


async def _receive(socket: web.WebSocketResponse, within_s: float | None = None) -> dict[str, Any]:
    message = await socket.receive(within_s)
    if message.type is not WSMsgType.TEXT:
        raise ConnectionError
    try:
        body = read_json(message.data)
    except (ValueError, RecursionError) as error:
        raise _InvalidMessageError("no JSON") from error
    if not isinstance(body, dict):
        raise _InvalidMessageError("an object is needed")
    return body


def _hello(raw: dict[str, Any]) -> _Hello:
    if raw.get("op") != "hello":
        raise _InvalidMessageError("op hello is expected first")
    console, operator = raw.get("console"), raw.get("operator")
    if not isinstance(console, str) or not 0 < len(console) <= MAX_NAME_LENGTH:
        raise _InvalidMessageError(f"console: a name of 1 to {MAX_NAME_LENGTH} characters")
    if operator is not None and not (isinstance(operator, str) and is_valid_source(operator)):
        raise _InvalidMessageError("operator: a name of 1 to 256 printable characters")
    resume = raw.get("resume")
    resume = resume if isinstance(resume, dict) else {}
    topics = _list(raw.get("topics", []))
    return _Hello(console, operator, topics, resume.get("instance"), resume.get("seq"))


def _topics(raw: dict[str, Any]) -> tuple[str, ...]:
    if raw.get("op") != "sub":
        raise _InvalidMessageError("op sub is expected")
    return _list(raw.get("topics"))


def _list(topics: object) -> tuple[str, ...]:
    if (
        not isinstance(topics, list)
        or len(topics) > MAX_TOPICS
        or any(not isinstance(topic, str) for topic in topics)
    ):
        raise _InvalidMessageError(f"topics: a list of at most {MAX_TOPICS} texts")
    return tuple(topics)
