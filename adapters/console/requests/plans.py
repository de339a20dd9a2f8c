"""Requests that submit plans, and read submitted ones."""

from collections.abc import Mapping
from functools import partial
from http import HTTPStatus
from typing import Any, Final

from aiohttp import web

from adapters.console.archive import Archive, PlanRevision, add_plan_revision, get_plan, list_plans
from adapters.console.requests.commanding import Commanding, CommandPost, identifier
from adapters.console.rovers import form_values
from adapters.console.web import OPERATOR, body_of, json_response, refused, text_of
from executive.commands import PlanArgument, PlanDefinition, SubmitPlan, declaration_of
from executive.plans import FORMAT

MAX_PLAN_OCTETS: Final = 256 * 1024
"""Maximum size of a plan, in octets."""
SUBMIT: Final = declaration_of(SubmitPlan).name


class PlanRequests:
    """Serves these requests.

    Args:
        commanding: sends plans.
        archive: stores them.
    """

    def __init__(self, commanding: Commanding, archive: Archive) -> None:
        self._commanding, self._archive = commanding, archive

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.post("/api/plans/{asset}", self._submit),
            web.get("/api/plans/{asset}", self._list),
            web.get("/api/plans/{asset}/{revision:[0-9]{1,18}}", self._get),
        ]

    async def _submit(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        asset, operator = request.match_info["asset"], request[OPERATOR]
        plan = _plan_of(body)
        submit = SubmitPlan(plan)
        posted = CommandPost(identifier(body.get("id")), asset, SUBMIT, form_values(submit))
        status = await self._commanding.send(operator, posted, lambda: submit)
        revision = PlanRevision(
            asset, plan.plan_id, 0, status.id, operator, status.made, plan.content.decode()
        )
        await self._archive.write(partial(add_plan_revision, revision=revision))
        return json_response(status, HTTPStatus.ACCEPTED)

    async def _list(self, request: web.Request) -> web.Response:
        asset = request.match_info["asset"]
        return json_response({"plans": await self._archive.read(partial(list_plans, asset=asset))})

    async def _get(self, request: web.Request) -> web.Response:
        asset, revision = request.match_info["asset"], int(request.match_info["revision"])
        found = await self._archive.read(partial(get_plan, asset=asset, revision=revision))
        if found is None:
            raise refused(HTTPStatus.NOT_FOUND, f"{asset} has no plan of revision {revision}")
        return json_response(found)


def _plan_of(body: dict[str, Any]) -> PlanDefinition:
    plan_id = text_of(body, "plan_id")
    content, arguments = body.get("content"), body.get("arguments", {})
    if not isinstance(content, str) or not 0 < len(content.encode()) <= MAX_PLAN_OCTETS:
        text = f"content: the XML of a plan, of at most {MAX_PLAN_OCTETS // 1024} KiB, is needed"
        raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="content")
    if not isinstance(arguments, Mapping) or not all(
        isinstance(value, str) for value in arguments.values()
    ):
        text = "arguments: an object of texts is needed, as the plan reads them by {NAME}"
        raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="arguments")
    given = tuple(PlanArgument(name, value) for name, value in arguments.items())
    name = text_of(body, "name") if "name" in body else plan_id
    return PlanDefinition(plan_id, name, FORMAT, content.encode(), given)
