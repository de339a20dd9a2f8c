"""HTTP requests for objects that operators share, such as displays, and for submitted plans."""

import asyncio
import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from http import HTTPStatus
from typing import Any, Final

from aiohttp import web
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    POLL_S,
    Archive,
    PlanRevision,
    RevisionConflict,
    add_plan_revision,
    delete_object,
    get_object,
    get_plan,
    list_objects,
    list_plans,
    put_object,
)
from adapters.console.messages import ObjectChanged
from adapters.console.requests.commanding import Commanding, CommandPost, identifier
from adapters.console.web import OPERATOR, body_of, invalid, json_response, refused, text_of
from executive.commands import (
    PlanArgument,
    PlanDefinition,
    SubmitPlan,
    argument_values,
    declaration_of,
)
from executive.plans import FORMAT

MAX_KEY_LENGTH: Final = 256
MAX_VALUE_LENGTH: Final = 512 * 1024
_REVISION: Final = re.compile(r"[0-9]{1,18}")
MAX_PLAN_OCTETS: Final = 256 * 1024
"""Maximum size of a plan, in octets."""
SUBMIT: Final = declaration_of(SubmitPlan).name


class SharedObjectRequests:
    """Serves displays and other objects that operators share.

    Args:
        archive: stores the objects.
        publish: notifies pages of a changed object.
    """

    def __init__(self, archive: Archive, publish: Callable[[ObjectChanged], None]) -> None:
        self._archive, self._publish = archive, publish
        self._published: dict[str, int] | None = None
        self._refreshing = asyncio.Lock()

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/objects", self._list),
            web.get("/api/objects/{key}", self._get),
            web.put("/api/objects/{key}", self._put),
            web.delete("/api/objects/{key}", self._delete),
        ]

    async def run(self) -> None:
        """Publish changes of other consoles periodically."""
        while True:
            with suppress(SQLAlchemyError):  # the archive logs that it cannot be written
                await self.refresh()
            await asyncio.sleep(POLL_S)

    async def refresh(self) -> None:
        """Publish objects that changed since the last call; the first call publishes none."""
        async with self._refreshing:
            found = dict(await self._archive.read(list_objects))
            known = found if self._published is None else self._published
            for key in known.keys() | found.keys():
                if known.get(key) != found.get(key):
                    self._publish(ObjectChanged(key, found.get(key)))
            self._published = found

    async def _list(self, _: web.Request) -> web.Response:
        found = await self._archive.read(list_objects)
        return json_response(
            {"objects": [{"key": key, "revision": number} for key, number in found]}
        )

    async def _get(self, request: web.Request) -> web.Response:
        key = request.match_info["key"]
        found = await self._archive.read(partial(get_object, key=key))
        if found is None:
            raise refused(HTTPStatus.NOT_FOUND, f"no object {key!r}")
        response = json_response(
            {
                "key": key,
                "revision": found.revision,
                "operator": found.operator,
                "value": json.loads(found.value),
            }
        )
        response.headers["ETag"] = f'"{found.revision}"'
        return response

    async def _put(self, request: web.Request) -> web.Response:
        key = request.match_info["key"]
        if not 0 < len(key) <= MAX_KEY_LENGTH or not key.isprintable():
            text = f"a key has 1 to {MAX_KEY_LENGTH} printable characters"
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="key")
        body = await body_of(request)
        value = json.dumps(body.get("value"), separators=(",", ":"))
        if "value" not in body or len(value) > MAX_VALUE_LENGTH:
            raise invalid("value", f"any JSON of at most {MAX_VALUE_LENGTH} characters is needed")
        revision = None if request.headers.get("If-None-Match") == "*" else _if_match(request)
        operator, utc_s = request[OPERATOR], self._archive.utc()
        await self.refresh()  # the first state that is read is not published
        done = await self._archive.write(
            lambda connection: put_object(connection, key, value, revision, operator, utc_s)
        )
        if isinstance(done, RevisionConflict):
            raise _conflict(key, done)
        await self.refresh()
        response = json_response({"key": key, "revision": done.revision})
        response.headers["ETag"] = f'"{done.revision}"'
        return response

    async def _delete(self, request: web.Request) -> web.Response:
        key, revision = request.match_info["key"], _if_match(request)
        await self.refresh()
        conflict = await self._archive.write(partial(delete_object, key=key, revision=revision))
        if conflict is not None:
            raise _conflict(key, conflict)
        await self.refresh()
        return web.Response(status=HTTPStatus.NO_CONTENT)


def _if_match(request: web.Request) -> int:
    given = request.headers.get("If-Match", "").strip('"')
    if not _REVISION.fullmatch(given):
        text = (
            'the header If-Match: "REVISION" is needed, with the revision to change; for a new'
            " object If-None-Match: *"
        )
        raise refused(HTTPStatus.PRECONDITION_REQUIRED, text)
    return int(given)


def _conflict(key: str, conflict: RevisionConflict) -> Exception:
    if conflict.revision is None:
        return refused(HTTPStatus.PRECONDITION_FAILED, f"object {key!r} was deleted")
    text = f"{key!r} is at revision {conflict.revision}: read and change that revision"
    return refused(HTTPStatus.PRECONDITION_FAILED, text, revision=conflict.revision)


class PlanRequests:
    """Submits plans, and serves the submitted ones.

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
        plan = plan_of(body)
        submit = SubmitPlan(plan)
        posted = CommandPost(identifier(body.get("id")), asset, SUBMIT, argument_values(submit))
        status = await self._commanding.send(operator, posted, lambda: submit)
        revision = PlanRevision(
            asset, plan.plan_id, 0, status.id, operator, status.created, plan.content.decode()
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


def plan_of(body: dict[str, Any]) -> PlanDefinition:
    """Return the plan of a body.

    Raises:
        RequestError: a field is invalid.
    """
    plan_id = text_of(body, "plan_id")
    content, arguments = body.get("content"), body.get("arguments", {})
    if not isinstance(content, str) or not 0 < len(content.encode()) <= MAX_PLAN_OCTETS:
        text = f"the XML of a plan, of at most {MAX_PLAN_OCTETS // 1024} KiB, is needed"
        raise invalid("content", text)
    if not isinstance(arguments, Mapping) or not all(
        isinstance(value, str) for value in arguments.values()
    ):
        text = "an object of texts is needed, as the plan reads them by {NAME}"
        raise invalid("arguments", text)
    given = tuple(PlanArgument(name, value) for name, value in arguments.items())
    name = text_of(body, "name") if "name" in body else plan_id
    return PlanDefinition(plan_id, name, FORMAT, content.encode(), given)
