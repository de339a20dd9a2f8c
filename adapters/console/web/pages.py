"""The pages, and their files at addresses with the version of all files, for caches of browsers.

A page names each module that its modules import: a browser then requests all of them at once.
"""

import re
from hashlib import sha256
from http import HTTPStatus
from pathlib import Path
from typing import Final

from aiohttp import web

from adapters.console.web.access import Access
from adapters.console.web.responses import refused

_PAGES: Final = {"/": "index.html", "/lite": "lite.html"}
_CACHED: Final = {"Cache-Control": "public, max-age=31536000, immutable"}
_FILE: Final = re.compile(r'(?<=")/(?=app/|vendor/)')
_ENTRY: Final = re.compile(
    r'<(?:script type="module" src|link rel="modulepreload" href)="/([^"]+)">(?:</script>)?'
)
_COMMENT: Final = re.compile(r"^[ \t]*/\*\*(?:(?!\*/).)*\*/$", re.MULTILINE | re.DOTALL)
_IMPORT: Final = re.compile(r'^(?:im|ex)port [^(]*? from "(\.[^"]+)";$', re.MULTILINE)


def page_routes(static: Path, access: Access) -> list[web.RouteDef]:
    """Return the routes of the pages in a folder, and of its files by their version."""

    async def page(request: web.Request) -> web.Response:
        text = (static / _PAGES[request.path]).read_text(encoding="utf-8")
        text = _FILE.sub(f"/{_version(static)}/", preloading(static, text))
        response = web.Response(text=text, content_type="text/html")
        if request.path == "/":
            access.allow_templates(response)
        return response

    async def file(request: web.Request) -> web.StreamResponse:
        path = (static / request.match_info["path"]).resolve()
        if not path.is_relative_to(static.resolve()):
            raise refused(HTTPStatus.NOT_FOUND, f"there is no {request.path}")
        if path.suffix != ".js" or not path.is_file():  # packages are stored compressed
            return web.FileResponse(path, headers=_CACHED)
        return web.Response(
            text=without_comments(path.read_text(encoding="utf-8")),
            content_type="text/javascript",
            headers=_CACHED,
        )

    versioned = r"/{version:[0-9a-f]{16}}/{path:.+}"
    return [*(web.get(path, page) for path in _PAGES), web.get(versioned, file)]


def without_comments(module: str) -> str:
    """Return a module without its documentation, a fifth of its octets; lines do not move."""
    return _COMMENT.sub(lambda comment: "\n" * comment[0].count("\n"), module)


def preloading(static: Path, page: str) -> str:
    """Return a page that names, after each module, those that this one imports, nearest first."""
    known = set(_ENTRY.findall(page))

    def with_imports(entry: re.Match[str]) -> str:
        found = [entry[1]]
        for module in found:
            path = static / module
            for name in _IMPORT.findall(path.read_text(encoding="utf-8")):
                imported = (path.parent / name).resolve().relative_to(static.resolve()).as_posix()
                if imported not in known:
                    known.add(imported)
                    found.append(imported)
        links = (f'<link rel="modulepreload" href="/{each}">' for each in found[1:])
        return "".join((entry[0], *links))

    return _ENTRY.sub(with_imports, page)


def _version(static: Path) -> str:
    """Return a name of the content of all files; the manifest has the hashes of the vendored."""
    digest = sha256((static / "vendor" / "MANIFEST.json").read_bytes())
    for path in sorted((static / "app").rglob("*.*")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
