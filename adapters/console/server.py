"""The console's HTTP server: its routes, and how they are answered."""

from collections.abc import Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.access import Access
from adapters.console.answers import MOST_OCTETS, answer, refusals
from adapters.console.fleet import Fleet
from adapters.console.hub import Hub
from adapters.console.sockets import Sockets

STATIC: Final = Path(__file__).parent / "static"
_NO_PAGES: Final = (
    "The console is running; its pages are not installed. What it serves is in"
    " adapters/console/README.md."
)


class Server:
    """Answers pages and programs.

    Args:
        hub: what goes to the pages.
        fleet: the assets.
        access: who may ask.
        routes: where else is answered.
    """

    def __init__(
        self, hub: Hub, fleet: Fleet, access: Access, routes: Sequence[web.RouteDef]
    ) -> None:
        self._hub, self._fleet = hub, fleet
        self._access = access
        self._routes = routes

    def application(self) -> web.Application:
        """Return what a runner serves."""
        application = web.Application(
            middlewares=[refusals, self._access.middleware], client_max_size=MOST_OCTETS
        )
        sockets = Sockets(self._hub, self._access)
        application.on_shutdown.append(sockets.close)
        application.add_routes(
            [
                web.get("/healthz", self._health),
                web.post("/api/login", self._access.login),
                web.get("/api/dictionary", self._dictionary),
                *self._routes,
                web.get("/ws", sockets.serve),
                web.get("/", self._index),
                web.static("/", STATIC, append_version=False),
            ]
        )
        return application

    async def _health(self, _: web.Request) -> web.Response:
        return answer({"instance": self._hub.instance})

    async def _dictionary(self, _: web.Request) -> web.Response:
        return answer({"assets": {each.asset: each for each in self._fleet.entries()}})

    async def _index(self, _: web.Request) -> web.StreamResponse:
        index = STATIC / "index.html"
        if not index.is_file():
            return web.Response(text=_NO_PAGES, status=HTTPStatus.OK)
        return web.FileResponse(index)
