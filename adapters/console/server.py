"""The console's HTTP server: routes, middlewares and pages."""

from collections.abc import Callable, Iterable, Sequence
from http import HTTPStatus
from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.rovers import AssetEntry
from adapters.console.web import (
    MAX_BODY_OCTETS,
    Access,
    Handler,
    Hub,
    Sockets,
    error_middleware,
    json_response,
    refused,
)

STATIC: Final = Path(__file__).parent / "static"
_PAGES: Final = {"/": "index.html", "/lite": "lite.html"}
_CONDITIONS: Final = ("If-None-Match", "If-Modified-Since")


class Server:
    """Serves pages and the HTTP interface.

    Args:
        hub: sends messages to the pages.
        entries: returns the dictionary entry of each asset.
        own: dictionary entry of this console.
        access: authenticates requests.
        routes: further routes.
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
        """Return the aiohttp application."""
        application = web.Application(
            middlewares=[error_middleware, self._access.middleware, _compressed],
            client_max_size=MAX_BODY_OCTETS,
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
        return json_response({"instance": self._hub.instance})

    async def _dictionary(self, _: web.Request) -> web.Response:
        assets = {each.asset: each for each in self._entries()}
        return json_response({"assets": assets, "console": self._own})

    async def _page(self, request: web.Request) -> web.StreamResponse:
        response = web.FileResponse(STATIC / _PAGES[request.path])
        if request.path == "/":
            self._access.allow_templates(response)
        return response


@web.middleware
async def _compressed(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Compress pages and JSON if the client accepts it; compressed files are sent unchanged.

    Responses to conditional requests and to HEAD are not compressed: aiohttp would send the end of
    a compressed body where there is none, and the browser would read that as the next response.
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
    text = f"there is no {request.path}: see docs/console.md"
    raise refused(HTTPStatus.NOT_FOUND, text)
