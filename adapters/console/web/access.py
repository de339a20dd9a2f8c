"""`Access` to the console: local clients need no token, remote clients need one.

Pages of other sites in the same browser can neither read nor post. The Host of a request must be
served here, and its Origin, if any, must equal it. Requests that change state need a header that
pages of other sites cannot send.
"""

import asyncio
import hmac
from collections.abc import Callable, Mapping
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from aiohttp import web

from adapters.console.web.responses import Handler, body_of, json_response, refused, text_of
from adapters.process import StartError
from executive.commands.intake import is_valid_source

OPERATOR_HEADER: Final = "X-Rover-Operator"
"""Header with the percent-encoded operator name; needed by requests that change state."""
COOKIE: Final = "rover_console"
MIN_TOKEN_LENGTH: Final = 16
DEFAULT_OPERATOR: Final = "MOE"
GUESS_S: Final = 0.5
"""Delay that each wrong token adds to the next response to the same address, s."""
MAX_WAIT_S: Final = 5.0
MAX_PEERS: Final = 1000
_READING: Final = {"GET", "HEAD"}
_POLICY: Final = (
    "default-src 'self'; script-src 'self'{scripts}; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:;"
    " object-src 'none'; base-uri 'self'; frame-ancestors 'self'"
)
_POLICY_HEADER: Final = "Content-Security-Policy"

OPERATOR: Final = web.RequestKey("operator", str)


def read_tokens(path: Path) -> dict[str, str]:
    """Return operators by their tokens, from a file with lines `NAME TOKEN`.

    Raises:
        StartError: the file cannot be read, or has an invalid line.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise StartError(f"--tokens: {path} cannot be read ({error})") from error
    tokens: dict[str, str] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.startswith("#"):
            continue
        name, _, token = line.rpartition(" ")
        name = name.strip()
        if not is_valid_source(name) or len(token) < MIN_TOKEN_LENGTH:
            raise StartError(
                f"--tokens: {path}, line {number}: write NAME TOKEN, the token of at least"
                f" {MIN_TOKEN_LENGTH} characters, as `openssl rand -hex 16` makes one"
            )
        if token in tokens:
            raise StartError(f"--tokens: {path}, line {number}: duplicate token")
        tokens[token] = name
    if not tokens:
        raise StartError(f"--tokens: {path} has no line NAME TOKEN")
    return tokens


class TokenGuesses:
    """Delays guesses of tokens by address, at most by `MAX_WAIT_S`.

    A right token is delayed as a wrong one, so that the delay reveals nothing. After its first use
    from an address it is not delayed, so guesses delay no operator and no stop.
    """

    def __init__(self, now_s: Callable[[], float]) -> None:
        self._now_s = now_s
        self._until_s: dict[str, float] = {}
        self._proven: set[tuple[str, str | None]] = set()

    def wait_s(self, peer: str, name: str | None) -> float:
        """Return the delay of the response to a token, s; `name` is None for a wrong token."""
        if (peer, name) in self._proven:
            return 0.0
        now_s = self._now_s()
        left_s = max(0.0, self._until_s.get(peer, now_s) - now_s)
        if len(self._until_s) + len(self._proven) >= MAX_PEERS:
            self._until_s, self._proven = {}, set()
        if name is None:
            self._until_s[peer] = now_s + min(left_s + GUESS_S, MAX_WAIT_S)
        else:
            self._proven.add((peer, name))
        return left_s


class Access:
    """Authenticates requests, and identifies their operators.

    Args:
        tokens: operators by their tokens; None if clients may use any name.
        secure: whether it is served by TLS.
        now_s: monotonic clock, s.
    """

    def __init__(
        self, tokens: Mapping[str, str] | None, secure: bool, now_s: Callable[[], float]
    ) -> None:
        self._tokens = tokens
        self._secure = secure
        self._guesses = TokenGuesses(now_s)

    @property
    def named(self) -> bool:
        """Whether tokens identify the operators."""
        return self._tokens is not None

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse requests of other origins or without a token; set the operator of the request."""
        self._require_own_origin(request)
        if request.path.startswith(("/api/", "/ws", "/metrics")) and request.path != "/api/login":
            request[OPERATOR] = await self._operator(request)
        response = await handler(request)
        if not response.prepared:
            response.headers["X-Content-Type-Options"] = "nosniff"
            if "Cache-Control" not in response.headers:  # a file of a page has the page's policy
                response.headers.setdefault(_POLICY_HEADER, _POLICY.format(scripts=""))
                response.headers["Referrer-Policy"] = "no-referrer"
                response.headers["Cache-Control"] = "no-cache"
        return response

    def allow_templates(self, page: web.StreamResponse) -> None:
        """Permit `unsafe-eval` on a page: Open MCT compiles its templates at run time."""
        page.headers[_POLICY_HEADER] = _POLICY.format(scripts=" 'unsafe-eval'")

    async def login(self, request: web.Request) -> web.Response:
        """Check a token, and set it as a cookie that scripts cannot read."""
        token = text_of(await body_of(request), "token")
        name = await self._operator_of(request, token)
        if name is None:
            raise refused(HTTPStatus.UNAUTHORIZED, "unknown token")
        response = json_response({"operator": name})
        response.set_cookie(
            COOKIE, token, httponly=True, secure=self._secure, samesite="Strict", path="/"
        )
        return response

    async def _operator(self, request: web.Request) -> str:
        header = request.headers.get(OPERATOR_HEADER)
        claimed = None if header is None else unquote(header)
        if request.method not in _READING and claimed is None:
            raise refused(
                HTTPStatus.FORBIDDEN, f"the header {OPERATOR_HEADER} is needed: the operator name"
            )
        if self._tokens is None:
            name = claimed or DEFAULT_OPERATOR
            if not is_valid_source(name):
                text = f"{OPERATOR_HEADER}: a name of at most 256 printable characters is needed"
                raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text)
            return name
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        given = token if scheme == "Bearer" else request.cookies.get(COOKIE, "")
        proven = await self._operator_of(request, given)
        if proven is None:
            text = "a token is needed: log in, or send `Authorization: Bearer TOKEN`"
            raise refused(HTTPStatus.UNAUTHORIZED, text)
        return proven

    async def _operator_of(self, request: web.Request, token: str) -> str | None:
        """Return the operator of a token after the sender's delay; None for a wrong token."""
        found = None
        for known, name in (self._tokens or {}).items():
            if hmac.compare_digest(known.encode(), token.encode(errors="surrogatepass")):
                found = name
        if token and self._tokens and (wait_s := self._guesses.wait_s(request.remote or "", found)):
            await asyncio.sleep(wait_s)
        return found

    def _require_own_origin(self, request: web.Request) -> None:
        origin = request.headers.get("Origin")
        if origin is not None and origin.partition("://")[2] != request.host:
            raise refused(HTTPStatus.FORBIDDEN, f"requests of pages of {origin[:100]} are refused")
        # DNS rebinding: a foreign name that resolves to this host would be an origin of its own.
        if self._tokens is None and not _is_local(request.host):
            raise refused(HTTPStatus.FORBIDDEN, "use the host 127.0.0.1 or localhost")


def _is_local(host: str) -> bool:
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ip_address(name).is_loopback
    except ValueError:
        return False
