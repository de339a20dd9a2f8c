"""HTTP requests for commands, stops, previews and the authority; `commanding` sends them."""

import asyncio
from http import HTTPStatus

from aiohttp import web

from adapters.console.messages import LinkKind
from adapters.console.requests.commanding import Commanding, parse_command_post
from adapters.console.requests.stops import Stops
from adapters.console.rovers import OperatorAuthority
from adapters.console.web import (
    OPERATOR,
    body_of,
    is_number,
    json_response,
    one_of,
    refused,
    text_of,
)
from executive.core.authority import AuthorityAction, AuthorityRequest

QUERY_TIMEOUT_S = 10.0
"""Timeout of an authority request, s."""


class OperationRequests:
    """Serves these requests.

    Args:
        commanding: sends commands, stops and preview requests.
        stops: calls stops off.
        desk: performs actions on the authority.
    """

    def __init__(self, commanding: Commanding, stops: Stops, desk: OperatorAuthority) -> None:
        self._commanding, self._stops, self._desk = commanding, stops, desk

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.post("/api/commands", self._command),
            web.post("/api/stop/{asset}", self._stop),
            web.delete("/api/stop/{asset}", self._call_off),
            web.post("/api/preview", self._preview),
            web.get("/api/authority", self._authority),
            web.post("/api/authority/{asset}", self._change_authority),
        ]

    async def _command(self, request: web.Request) -> web.Response:
        posted = parse_command_post(await body_of(request))
        status = await self._commanding.post(request[OPERATOR], posted)
        return json_response(status, HTTPStatus.ACCEPTED)

    async def _stop(self, request: web.Request) -> web.Response:
        age_s = (await body_of(request)).get("age") if request.can_read_body else None
        age_s = max(age_s, 0.0) if is_number(age_s) else 0.0
        status = self._commanding.stop(request[OPERATOR], request.match_info["asset"], age_s)
        return json_response(status, HTTPStatus.ACCEPTED)

    async def _call_off(self, request: web.Request) -> web.Response:
        asset = request.match_info["asset"]
        return json_response(self._stops.call_off(request[OPERATOR], asset))

    async def _preview(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        asset, name = text_of(body, "asset"), text_of(body, "name")
        return json_response(await self._commanding.preview(asset, name, body.get("args", {})))

    async def _authority(self, _: web.Request) -> web.Response:
        return json_response({"authority": self._desk.held})

    async def _change_authority(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        action = one_of(AuthorityAction, "action", body.get("action"))
        wanted = None if body.get("link") is None else one_of(LinkKind, "link", body["link"])
        to = text_of(body, "to") if action is AuthorityAction.HAND_OVER else ""
        lease_s = body.get("lease")
        if lease_s is not None and (
            isinstance(lease_s, bool) or not isinstance(lease_s, int | float)
        ):
            text = "lease: seconds are needed"
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="lease")
        link = self._commanding.link(request.match_info["asset"], wanted)
        lease_s = None if lease_s is None else float(lease_s)
        wish = AuthorityRequest(action, request[OPERATOR], to=to, lease_s=lease_s)
        try:
            async with asyncio.timeout(QUERY_TIMEOUT_S + link.delay.declared_s):
                return json_response(await self._desk.request(link, wish))
        except TimeoutError as error:
            text = f"{link.asset} does not answer: the result is unknown"
            raise refused(HTTPStatus.GATEWAY_TIMEOUT, text) from error
