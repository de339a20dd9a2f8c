"""Pages of `docs/` for the browser, as the help of the views."""

import re
from collections.abc import Iterator
from html import escape
from http import HTTPStatus
from itertools import pairwise
from pathlib import Path
from typing import Final

from aiohttp import web
from markdown_it import MarkdownIt
from markdown_it.token import Token

from adapters.console.web.responses import refused

PAGES: Final = {
    "console": "Console",
    "command-a-rover": "Command a rover",
    "write-a-plan": "Plans",
    "why": "Why",
    "faults": "Faults",
    "relay": "Relay",
    "glossary": "Glossary",
}
"""Pages linked from the top of each page."""
_PICTURES: Final = {".webp": "image/webp", ".svg": "image/svg+xml", ".jpg": "image/jpeg"}
_MARKDOWN: Final = MarkdownIt("commonmark").enable("table")


def help_routes(docs: Path) -> list[web.RouteDef]:
    """Return the routes of the pages and pictures of a folder; none if it does not exist."""

    async def page(request: web.Request) -> web.StreamResponse:
        path = docs / request.match_info["file"]
        if not path.is_file():
            raise refused(HTTPStatus.NOT_FOUND, f"there is no {request.path}")
        if path.suffix != ".md":
            return web.FileResponse(path, headers={"Content-Type": _PICTURES[path.suffix]})
        text = path.read_text(encoding="utf-8")
        return web.Response(text=render(text), content_type="text/html")

    async def first(_: web.Request) -> web.Response:
        raise web.HTTPFound("/help/console.md")

    if not docs.is_dir():
        return []
    return [
        web.get("/help", first),
        web.get(r"/help/{file:[a-z0-9-]+\.md}", page),
        web.get(r"/help/{file:images/[a-z0-9-]+\.(webp|svg|jpg)}", page),
    ]


def render(text: str) -> str:
    """Return a page of Markdown as HTML; headings have the anchors that its links use."""
    tokens = _MARKDOWN.parse(text)
    titles = list(_set_anchors(tokens))
    for token in (child for each in tokens for child in each.children or ()):
        if token.type == "link_open" and str(token.attrs["href"]).startswith(".."):
            token.attrs = {}  # a file of the checkout
    body = _MARKDOWN.renderer.render(tokens, _MARKDOWN.options, {})
    pages = "".join(f'<a href="/help/{name}.md">{title}</a>' for name, title in PAGES.items())
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(titles[0] if titles else 'Help')}</title>"
        '<link rel="icon" href="/app/icon.svg"><link rel="stylesheet" href="/app/console.css">'
        f'</head><body class="help"><nav><a href="/">Rovers</a>{pages}</nav>'
        f"<main>{body}</main></body></html>"
    )


def _set_anchors(tokens: list[Token]) -> Iterator[str]:
    """Set the anchors of the headings, as on the usual hosts; yield their texts."""
    for heading, content in pairwise(tokens):
        if heading.type == "heading_open":
            title = "".join(child.content for child in content.children or ())
            heading.attrs["id"] = re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")
            yield title
