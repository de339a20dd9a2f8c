"""The console's HTTP server: its routes, and how they are answered."""

from collections.abc import Callable, Iterable, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.rovers import AssetEntry
from adapters.console.web import (
    MOST_OCTETS,
    Access,
    Handler,
    Hub,
    Sockets,
    answer,
    refusals,
    refused,
)

STATIC: Final = Path(__file__).parent / "static"
_PAGES: Final = {"/": "index.html", "/lite": "lite.html"}
_CONDITIONS: Final = ("If-None-Match", "If-Modified-Since")


class Server:
    """Answers pages and programs.

    Args:
        hub: what goes to the pages.
        entries: returns what there is of each asset.
        own: what there is of this console.
        access: who may ask.
        routes: where else is answered.
    """

    def __init__(
        self,
        hub: Hub,
        entries: Callable[[], Iterable[AssetEntry]],
        own: AssetEntry,
        access: Access,
        routes: Sequence[web.RouteDef],
    ) -> None:
        self._hub, self._entries, self._own = hub, entries, own
        self._access = access
        self._routes = routes

    def application(self) -> web.Application:
        """Return what a runner serves."""
        application = web.Application(
            middlewares=[refusals, self._access.middleware, _compressed],
            client_max_size=MOST_OCTETS,
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
                web.get("/api/{rest:.*}", _nothing),
                *(web.get(path, self._page) for path in _PAGES),
                web.static("/", STATIC, append_version=False),
            ]
        )
        return application

    async def _health(self, _: web.Request) -> web.Response:
        return answer({"instance": self._hub.instance})

    async def _dictionary(self, _: web.Request) -> web.Response:
        assets = {each.asset: each for each in self._entries()}
        return answer({"assets": assets, "console": self._own})

    async def _page(self, request: web.Request) -> web.StreamResponse:
        response = web.FileResponse(STATIC / _PAGES[request.path])
        if request.path == "/":
            self._access.allow_templates(response)
        return response


@web.middleware
async def _compressed(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Compress pages and JSON for whoever takes it; what is kept compressed is sent as it is.

    A page that is only asked for if it has changed is not compressed, nor the answer to a HEAD:
    aiohttp would send the end of a compressed body where there is none, and the browser would take
    that for the next answer.
    """
    response = await handler(request)
    is_conditional = any(name in request.headers for name in _CONDITIONS)
    is_file = isinstance(response, web.FileResponse) and not request.path.startswith("/api/")
    is_page = is_file and not is_conditional
    is_json = isinstance(response, web.Response) and response.content_type == "application/json"
    if not response.prepared and (is_page or is_json) and request.method != "HEAD":
        response.enable_compression()
    return response


async def _nothing(request: web.Request) -> web.Response:
    text = f"there is no {request.path}: docs/console.md has what there is"
    raise refused(HTTPStatus.NOT_FOUND, text)
