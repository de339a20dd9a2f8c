"""Who may speak to the console: whoever is on this computer, elsewhere who has a token.

A page of another site, open in the same browser, may neither ask nor post: requests have to come
for a host that is served here and, if they have an Origin, from it; what changes something needs
a header that a page of another site cannot send.
"""

import hmac
from collections.abc import Mapping
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from aiohttp import web

from adapters.console.web.answers import Handler, answer, body_of, refused, text_of
from adapters.process import StartError
from executive.commands.intake import is_source

OPERATOR_HEADER: Final = "X-Rover-Operator"
"""Which every request has that changes something: who asks for it, percent-encoded."""
COOKIE: Final = "rover_console"
SHORTEST_TOKEN: Final = 16
DEFAULT_OPERATOR: Final = "MOE"
_READING: Final = {"GET", "HEAD"}
_POLICY: Final = (
    "default-src 'self'; script-src 'self'{scripts}; style-src 'self' 'unsafe-inline';"
    " img-src 'self' data: blob:; font-src 'self' data:; worker-src 'self' blob:;"
    " object-src 'none'; base-uri 'self'; frame-ancestors 'self'"
)
_POLICY_HEADER: Final = "Content-Security-Policy"

OPERATOR: Final = web.RequestKey("operator", str)


def read_tokens(path: Path) -> dict[str, str]:
    """Return operators by their tokens, of a file with lines `NAME TOKEN`.

    Raises:
        StartError: it cannot be read, or is not so.
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
        if not is_source(name) or len(token) < SHORTEST_TOKEN:
            raise StartError(
                f"--tokens: {path}, line {number}: write NAME TOKEN, the token of at least"
                f" {SHORTEST_TOKEN} characters, as `openssl rand -hex 16` makes one"
            )
        if token in tokens:
            raise StartError(f"--tokens: {path}, line {number}: this token is another's, too")
        tokens[token] = name
    if not tokens:
        raise StartError(f"--tokens: {path} has no line NAME TOKEN")
    return tokens


class Access:
    """Lets requests in, and says whose they are.

    Args:
        tokens: operators by their tokens; None where whoever reaches it may speak under any name.
        secure: whether it is served by TLS.
    """

    def __init__(self, tokens: Mapping[str, str] | None, secure: bool) -> None:
        self._tokens = tokens
        self._secure = secure

    @property
    def named(self) -> bool:
        """Whether tokens say who an operator is."""
        return self._tokens is not None

    @web.middleware
    async def middleware(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse what comes from elsewhere or without a token; note the operator."""
        self._require_own_origin(request)
        if request.path.startswith(("/api/", "/ws")) and request.path != "/api/login":
            request[OPERATOR] = self._operator(request)
        response = await handler(request)
        if not response.prepared:
            response.headers.setdefault(_POLICY_HEADER, _POLICY.format(scripts=""))
            response.headers["X-Content-Type-Options"] = "nosniff"
            response.headers["Referrer-Policy"] = "no-referrer"
            response.headers.setdefault("Cache-Control", "no-cache")
        return response

    def allow_templates(self, page: web.StreamResponse) -> None:
        """Let a page compile templates, as Open MCT does with its own: it runs what it reads."""
        page.headers[_POLICY_HEADER] = _POLICY.format(scripts=" 'unsafe-eval'")

    async def login(self, request: web.Request) -> web.Response:
        """Take a token, and let the browser keep it where no script can read it."""
        token = text_of(await body_of(request), "token")
        name = self._named(token)
        if name is None:
            raise refused(HTTPStatus.UNAUTHORIZED, "this token is nobody's")
        response = answer({"operator": name})
        response.set_cookie(
            COOKIE, token, httponly=True, secure=self._secure, samesite="Strict", path="/"
        )
        return response

    def _operator(self, request: web.Request) -> str:
        header = request.headers.get(OPERATOR_HEADER)
        claimed = None if header is None else unquote(header)
        if request.method not in _READING and claimed is None:
            raise refused(
                HTTPStatus.FORBIDDEN, f"the header {OPERATOR_HEADER} is needed: who asks for it"
            )
        if self._tokens is None:
            name = claimed or DEFAULT_OPERATOR
            if not is_source(name):
                text = f"{OPERATOR_HEADER}: a name of at most 256 printable characters is needed"
                raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text)
            return name
        scheme, _, token = request.headers.get("Authorization", "").partition(" ")
        given = token if scheme == "Bearer" else request.cookies.get(COOKIE, "")
        proven = self._named(given)
        if proven is None:
            text = "a token is needed: log in, or send `Authorization: Bearer TOKEN`"
            raise refused(HTTPStatus.UNAUTHORIZED, text)
        return proven

    def _named(self, token: str) -> str | None:
        found = None
        for known, name in (self._tokens or {}).items():
            if hmac.compare_digest(known.encode(), token.encode()):
                found = name
        return found

    def _require_own_origin(self, request: web.Request) -> None:
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise refused(HTTPStatus.FORBIDDEN, f"pages of {origin[:100]} may not ask here")
        # A name that leads here by a foreign name server would be an origin of its own.
        if self._tokens is None and not _is_local(request.host):
            raise refused(HTTPStatus.FORBIDDEN, "ask by 127.0.0.1 or localhost")


def _is_local(host: str) -> bool:
    name = urlsplit(f"//{host}").hostname or ""
    if name == "localhost":
        return True
    try:
        return ip_address(name).is_loopback
    except ValueError:
        return False
