"""The help of the views: pages of docs/, as the console serves them."""

import re
from http import HTTPStatus

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from adapters.console.service import STATIC
from adapters.console.web import error_middleware, help_routes
from adapters.console.web.help_pages import FRAME, render
from executive.settings import shipped_folder

DOCS = shipped_folder("docs")
VIEWS = (STATIC / "app" / "openmct" / "views.js").read_text()


def test_headings_have_the_anchors_of_links_to_them() -> None:
    page = render("# Camera, plans & `rover` *now*\n\n[up](../README.md) [there](why.md#causes)\n")
    assert "<title>Camera, plans &amp; rover now</title>" in page
    assert '<h1 id="camera-plans--rover-now">' in page
    assert '<a href="why.md#causes">' in page
    assert "README" not in page, "the console does not serve files of the checkout"


LINKS = re.findall(r'href="/help/([^"]+)"', FRAME.read_text())


@pytest.mark.parametrize("target", [*LINKS, *re.findall(r'help: "([^"]+)"', VIEWS)])
def test_help_of_each_view_exists(target: str) -> None:
    name, _, section = target.partition("#")
    page = render((DOCS / name).read_text())
    assert not section or f'id="{section}"' in page


async def test_pages_and_pictures_are_served_and_nothing_else() -> None:
    application = web.Application(middlewares=[error_middleware])
    application.add_routes(help_routes(DOCS))
    async with TestClient(TestServer(application)) as client:
        for path, status, kind in (
            ("/help", HTTPStatus.OK, "text/html"),
            ("/help/glossary.md", HTTPStatus.OK, "text/html"),
            ("/help/images/console.webp", HTTPStatus.OK, "image/webp"),
            ("/help/none.md", HTTPStatus.NOT_FOUND, "application/json"),
            ("/help/../README.md", HTTPStatus.NOT_FOUND, "text/plain"),
        ):
            async with client.get(path) as answer:
                assert (answer.status, answer.content_type) == (status, kind), path


def test_without_docs_there_is_no_help() -> None:
    assert help_routes(DOCS / "none") == []
