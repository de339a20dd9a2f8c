"""Helpers of HTTP handlers: parse bodies and queries, respond with JSON or with a refusal."""

import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import Enum
from errno import ENAMETOOLONG
from functools import partial
from http import HTTPStatus
from math import isfinite, nan
from typing import Any, Final, TypeGuard, TypeVar

from aiohttp import web
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import TablePage, cause_of, to_us
from adapters.console.messages import CommandStatus, plain

MAX_BODY_OCTETS: Final = 1 << 20
"""Maximum octets of a request body."""

THREAD_COMPRESS_OCTETS: Final = 1 << 16
"""Octets of a response from which on a thread compresses it, which does not block the loop."""
MAX_NUMBER: Final = 1e11
"""Maximum number in a query: three thousand years in seconds."""

LIMIT: Final = 200
MAX_LIMIT: Final = 1000
"""Maximum `limit` of a query; `LIMIT` is the default."""

T = TypeVar("T")
E = TypeVar("E", bound=Enum)
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True, slots=True)
class ErrorBody:
    """Body of a refusal; fields that are None are omitted.

    Attributes:
        error: human-readable sentence, with the remedy.
        field: invalid argument, with `low` and `high`, or `choices`, if known.
        holder: holder of the authority.
        command: status of the command that was posted before.
        revision: stored revision.
    """

    error: str
    field: str | None = None
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] | None = None
    holder: str | None = None
    command: CommandStatus | None = None
    revision: int | None = None


class RequestError(Exception):
    """Raised to refuse a request."""

    def __init__(self, status: HTTPStatus, problem: ErrorBody) -> None:
        super().__init__(problem.error)
        self.status = status
        self.problem = problem


def refused(status: HTTPStatus, error: str, **more: Any) -> RequestError:
    """Return the refusal of a request; `more` are fields of an `ErrorBody`."""
    return RequestError(status, ErrorBody(error, **more))


def invalid(field: str, text: str, **more: Any) -> RequestError:
    """Return the refusal of a request with an invalid field; its text begins with the field."""
    error = f"{field}: {text}"
    return refused(HTTPStatus.UNPROCESSABLE_ENTITY, error, field=field, **more)


def is_number(value: object) -> TypeGuard[float]:
    """Whether a value of a body is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def json_response(value: Any, status: HTTPStatus = HTTPStatus.OK) -> web.Response:
    """Return a response with a value as JSON."""
    text = json.dumps(plain(value), separators=(",", ":"))
    return json_answer(text, status)


@web.middleware
async def error_middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
    """Convert refusals, also those of aiohttp, to responses with an `ErrorBody`."""
    try:
        return await handler(request)
    except RequestError as refusal:
        body = {name: value for name, value in plain(refusal.problem).items() if value is not None}
        return json_response(body, refusal.status)
    except SQLAlchemyError as error:
        text = f"the archive cannot be used: {cause_of(error)}"
        return json_response({"error": text}, HTTPStatus.SERVICE_UNAVAILABLE)
    except OSError as error:
        if error.errno != ENAMETOOLONG:
            raise
        raise web.HTTPNotFound from error  # the path is too long for a file
    except web.HTTPException as error:
        if error.status < HTTPStatus.BAD_REQUEST or not request.path.startswith("/api/"):
            raise
        return json_response({"error": error.reason}, HTTPStatus(error.status))


async def body_of(request: web.Request) -> dict[str, Any]:
    """Return the JSON object in the body of a request.

    Raises:
        RequestError: the body is no JSON object.
    """
    try:
        body = await request.json(loads=read_json)
    except (ValueError, LookupError, RecursionError):  # no JSON, or an unknown encoding
        body = None
    if not isinstance(body, dict):
        raise refused(HTTPStatus.BAD_REQUEST, "the body must be a JSON object with finite numbers")
    return body


def read_json(text: str) -> Any:
    """Return the value of a JSON text; raise ValueError for a number beyond the range of float."""
    whole = partial(_finite, kind=int)
    return json.loads(text, parse_int=whole, parse_float=_finite, parse_constant=_finite)


def _finite(text: str, kind: Callable[[str], float] = float) -> float:
    if not isfinite(float(text)):
        raise ValueError(f"{text[:32]} is not finite")
    return kind(text)


def text_of(body: dict[str, Any], name: str, max_length: int = 256) -> str:
    """Return a text of a body.

    Raises:
        RequestError: the text is missing or invalid.
    """
    value = body.get(name)
    if not isinstance(value, str) or not 0 < len(value) <= max_length or not value.isprintable():
        raise invalid(name, f"a text of 1 to {max_length} printable characters is needed")
    return value


def number_of(request: web.Request, name: str, default: T) -> float | T:
    """Return a finite number of the query, or the default.

    Raises:
        RequestError: it is no such number.
    """
    given = request.query.get(name)
    if given is None:
        return default
    try:
        number = float(given)
    except ValueError:
        number = nan
    if not isfinite(number) or abs(number) > MAX_NUMBER:
        raise invalid(name, "a number is needed")
    return number


def count_of(request: web.Request, name: str, default: int, maximum: int) -> int:
    """Return a count of the query, from 1 to `maximum`.

    Raises:
        RequestError: it is out of range.
    """
    number = number_of(request, name, default)
    if not 1 <= number <= maximum:
        raise invalid(name, f"a number from 1 to {maximum} is needed", low=1, high=maximum)
    return int(number)


def requested_page(request: web.Request) -> TablePage:
    """Return the part of a table (asset, times, limit) that a query requests.

    Raises:
        RequestError: a parameter is invalid.
    """
    start, before = number_of(request, "start", None), number_of(request, "before", None)
    return TablePage(
        asset=request.query.get("asset"),
        start_us=None if start is None else to_us(start),
        before_us=None if before is None else to_us(before),
        limit=count_of(request, "limit", LIMIT, MAX_LIMIT),
    )


def one_of(kind: type[E], name: str, value: object) -> E:
    """Return the member of an Enum by its value.

    Raises:
        RequestError: the value is unknown.
    """
    choices = tuple(str(each.value) for each in kind)
    if value not in choices:
        raise invalid(name, f"one of {', '.join(choices)} is needed", choices=choices)
    return kind(value)


def json_answer(text: str, status: HTTPStatus = HTTPStatus.OK) -> web.Response:
    """Return a response with encoded JSON."""
    return web.Response(
        text=text,
        status=status,
        content_type="application/json",
        zlib_executor_size=THREAD_COMPRESS_OCTETS,
    )
