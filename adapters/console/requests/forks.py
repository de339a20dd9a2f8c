"""HTTP requests for forks of recordings: a process of the simulation answers "what if"."""

import asyncio
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from importlib.util import find_spec
from typing import Any, Final

from aiohttp import web

from adapters.console.recordings import Recordings, is_connected
from adapters.console.web import body_of, invalid, is_number, refused

FORK: Final = "sim.fork"
"""Module that answers a question, with the options of `rover whatif`."""
ANSWERED: Final = (0, 1)
"""Its exit statuses with an answer; 1 if the fork without a change is not as recorded."""
LOWEST_PRIORITY: Final = 19
LIMIT_S: Final = 300.0
"""Maximum duration of a fork, s; chosen: an hour of recording takes 2 min."""
POLL_S: Final = 0.1
"""Period of the check whether the page is still there, s."""
TURN_S: Final = 1.0
"""Time within which the fork of a page that was left ends, s."""
MAX_CHANGES: Final = 20
"""Maximum number of changes of a kind."""
CHANGES: Final = ("set", "command", "drop", "without", "controller", "world")
"""Options of `rover whatif`, which reads their values."""


class ForkRequests:
    """Serves these requests, one fork at a time; a fork ends with the connection of its page.

    Args:
        recordings: opened recordings.
    """

    def __init__(self, recordings: Recordings) -> None:
        self._recordings = recordings
        self._running = asyncio.Lock()

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [web.post("/api/recordings/{asset}/fork", self._fork)]

    async def _fork(self, request: web.Request) -> web.Response:
        asset = request.match_info["asset"]
        recording = self._recordings.find(asset)
        if recording is None:
            raise refused(HTTPStatus.NOT_FOUND, f"there is no recording {asset[:64]!r} open")
        options = _options(await body_of(request))
        if any(find_spec(name) is None for name in ("sim", "mujoco")):
            text = "the simulation is not installed: pip install 'rover-executive[sim]'"
            raise refused(HTTPStatus.NOT_IMPLEMENTED, text)
        try:
            async with asyncio.timeout(TURN_S):
                await self._running.acquire()
        except TimeoutError:
            text = "another fork runs on this console: wait for its end"
            raise refused(HTTPStatus.CONFLICT, text) from None
        try:
            answer = await _answer(is_connected(request), str(recording.path), "--json", *options)
        finally:
            self._running.release()
        return web.Response(body=answer, content_type="application/json")


async def _answer(is_wanted: Callable[[], bool], *arguments: str) -> bytes:
    """Return the answer as JSON.

    Raises:
        RequestError: the question does not fit the recording, or the fork did not end in time.
    """
    try:
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-m", FORK, *arguments),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
    except (OSError, ValueError) as error:  # as a text with NUL, or too long
        raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, f"no process: {error}") from error
    reading = asyncio.ensure_future(process.communicate())
    try:
        with suppress(ProcessLookupError):  # telemetry and stops of this console go first
            os.setpriority(os.PRIO_PROCESS, process.pid, LOWEST_PRIORITY)
        async with asyncio.timeout(LIMIT_S):
            while not reading.done() and is_wanted():
                await asyncio.wait({reading}, timeout=POLL_S)
    except TimeoutError as error:
        text = f"the fork exceeded {LIMIT_S:g} s: use rover whatif, which has no limit"
        raise refused(HTTPStatus.GATEWAY_TIMEOUT, text) from error
    finally:
        if process.returncode is None:
            process.kill()
        answer, errors = await reading
    if process.returncode not in ANSWERED or not answer:
        lines = errors.decode(errors="replace").strip().splitlines()
        text = lines[-1].removeprefix("Error: ") if lines else f"status {process.returncode}"
        raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text)
    return answer


def _options(body: dict[str, Any]) -> list[str]:
    """Return the options of `rover whatif`; each value is joined to its name.

    Raises:
        RequestError: the body has another form.
    """
    found: list[str] = []
    for name in CHANGES:
        texts = body.get(name, [])
        is_list = isinstance(texts, list) and len(texts) <= MAX_CHANGES
        if not is_list or not all(isinstance(each, str) for each in texts):
            raise invalid(name, f"a list of at most {MAX_CHANGES} texts is needed")
        found += (f"--{name}={each}" for each in texts)
    if any("/" in each or each.endswith((".yaml", ".yml")) for each in body.get("world", [])):
        raise invalid("world", "the name of a world is needed, or scans: no file of this computer")
    if not found:
        text = "a change is needed: a setting, a command, a fault, a controller or a world"
        raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text)
    if (at_s := body.get("at")) is not None:
        if not (is_number(at_s) and at_s >= 0.0):
            raise invalid("at", "seconds since the start of the recording are needed")
        found.append(f"--at={at_s}")
    return found
