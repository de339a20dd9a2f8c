"""aiohttp, server and client, in simulated processes."""

import asyncio
from typing import Any

import aiohttp
from aiohttp import web

from tests.simulated.network import Channel
from tests.simulated.process import Process
from tests.simulated.world import World

A, B = "10.0.0.1", "10.0.0.2"


def test_pages_and_web_sockets() -> None:
    received: list[str] = []

    async def serve(process: Process) -> None:
        async def page(_: web.Request) -> web.Response:
            return web.Response(text=f"at {process.loop.time():.1f}")

        async def echo(request: web.Request) -> web.WebSocketResponse:
            back = web.WebSocketResponse()
            await back.prepare(request)
            async for message in back:
                await back.send_str(message.data)
            return back

        application = web.Application()
        application.router.add_get("/", page)
        application.router.add_get("/echo", echo)
        runner = web.AppRunner(application)
        await runner.setup()
        await web.TCPSite(runner, B, 80).start()
        await asyncio.Event().wait()

    async def query(process: Process) -> None:
        def unconnected(_: object) -> Any:
            return process.world.network.unconnected(process.present)

        connector = aiohttp.TCPConnector(socket_factory=unconnected)
        async with aiohttp.ClientSession(connector=connector) as session:
            async with session.get(f"http://{B}/") as answer:
                received.append(await answer.text())
            async with session.ws_connect(f"http://{B}/echo") as connection:
                await connection.send_str("hello")
                received.append(await connection.receive_str())
        async with aiohttp.ClientSession() as session:  # of the process that is killed
            await asyncio.Event().wait()

    with World(1) as world:
        world.network.set_channel(A, B, Channel(0.5))
        world.process("server", B, lambda process: process.run(serve(process))).begin()
        client = world.process("client", A, lambda process: process.run(query(process)))
        client.begin()
        world.at(10.0, client.kill)
        world.run(20.0)
        assert world.errors == []
    assert received == ["at 1.5", "hello"]
