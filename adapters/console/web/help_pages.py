"""Pages of `docs/` for the browser, as the help of the views."""

import re
from html import escape
from http import HTTPStatus
from itertools import pairwise
from pathlib import Path
from string import Template
from typing import Final

from aiohttp import web
from markdown_it import MarkdownIt

from adapters.console.web.responses import refused

FRAME: Final = Path(__file__).parents[1] / "static" / "help.html"
_PICTURES: Final = {".webp": "image/webp", ".svg": "image/svg+xml", ".jpg": "image/jpeg"}
_MARKDOWN: Final = MarkdownIt("commonmark").enable("table")


def help_routes(docs: Path) -> list[web.RouteDef]:
    """Return the routes of the pages and pictures of a folder; none if it does not exist."""

    async def page(request: web.Request) -> web.StreamResponse:
        path = docs / request.match_info.get("file", "")
        if path == docs:
            raise web.HTTPFound("/help/console.md")
        if not path.is_file():
            raise refused(HTTPStatus.NOT_FOUND, f"there is no {request.path}")
        if path.suffix != ".md":
            return web.FileResponse(path, headers={"Content-Type": _PICTURES[path.suffix]})
        text = path.read_text(encoding="utf-8")
        return web.Response(text=render(text), content_type="text/html")

    files = (r"/{file:[a-z0-9-]+\.md}", r"/{file:images/[a-z0-9-]+\.(webp|svg|jpg)}")
    return [web.get(f"/help{each}", page) for each in ("", *files)] if docs.is_dir() else []


def render(text: str) -> str:
    """Return a page of Markdown as HTML; headings have the anchors that its links use."""
    tokens = _MARKDOWN.parse(text)
    titles = []
    for heading, content in pairwise(tokens):
        if heading.type == "heading_open":
            titles.append("".join(child.content for child in content.children or ()))
            anchor = re.sub(r"[^\w\- ]", "", titles[-1].lower()).replace(" ", "-")
            heading.attrs["id"] = anchor
    for token in (child for each in tokens for child in each.children or ()):
        if token.type == "link_open" and str(token.attrs["href"]).startswith(".."):
            token.attrs = {}  # a file of the checkout
    body = _MARKDOWN.renderer.render(tokens, _MARKDOWN.options, {})
    return Template(FRAME.read_text()).substitute(title=escape(titles[0]), body=body)
