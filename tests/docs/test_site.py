"""The documentation site: its navigation, and the pages of a built one, named by SITE."""

import os
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import click
import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from tests.console.site import OPTIONS
from tests.docs.pages import CHECKOUT, PAGES
from tests.docs.site import broken_links, build
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED

built = pytest.mark.skipif("SITE" not in os.environ, reason="needs a built site: SITE=FOLDER")
in_browser = pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")
SITE = Path(os.environ.get("SITE", "")).absolute()
ENTRANCES = {
    "Drive it in five minutes": "docs/command-a-rover",
    "Set it up on your robot": "docs/add-a-rover",
    "What it guarantees": "docs/command-guarantees",
}
SHOWN = ("README", *ENTRANCES.values(), "docs/comparison", "docs/site/api")
BACKGROUND = "getComputedStyle(document.body).backgroundColor"


def test_the_navigation_has_every_page_once_and_begins_with_the_entrances() -> None:
    conf = runpy.run_path(str(CHECKOUT / "docs" / "site" / "conf.py"))
    groups = conf["navigation"](PAGES[0].read_text())
    pages = [page for group in groups.values() for _, page in group]
    assert len(pages) == len(set(pages))
    assert {f"docs/{page.stem}" for page in PAGES[1:]} <= set(pages)
    assert {"ARCHITECTURE", "CHANGELOG", "CONTRIBUTING", "docs/site/api"} <= set(pages)
    first = {caption: pages[0][1] for caption, pages in groups.items()}
    assert list(first.items())[:3] == list(ENTRANCES.items())


@pytest.mark.parametrize(
    ("page", "broken"),
    [
        ('<a href="b.html#there">', []),
        ('<a href="https://example.org/">', []),
        ('<a href="c.html">', ["a.html: c.html does not exist"]),
        ('<a href="b.html#none">', ["a.html: b.html#none has no such anchor"]),
        ('<a href="#none">', ["a.html: #none has no such anchor"]),
        ('<img src="https://a.org/b">', ["a.html: https://a.org/b is loaded from the network"]),
    ],
)
def test_broken_links_are_found(page: str, broken: list[str], tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(page)
    (tmp_path / "b.html").write_text('<h1 id="there">')
    assert list(broken_links(tmp_path)) == broken


def test_fonts_of_others_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.css").write_text("@import 'https://example.org/font.css';")
    assert list(broken_links(tmp_path)) == [
        "a.css: https://example.org/font.css is loaded from the network"
    ]


@built
@pytest.mark.parametrize("link", ["none.md", "other.md#none", "#none"])
def test_a_broken_link_ends_the_build(
    link: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "README.md").write_text(f"# A page\n\n[a link]({link})\n")
    (tmp_path / "other.md").write_text("---\norphan: true\n---\n\n# Another\n")
    with pytest.raises(click.ClickException):
        build(tmp_path / "site", tmp_path)
    assert capfd.readouterr().err.count("WARNING") == 1


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=BROWSER, args=list(OPTIONS))
        yield started
        started.close()


def visit(browser: Browser, url: str, **options: Any) -> Page:
    """Open a page from the disk, as a reader without a network does; nothing else may be loaded."""
    page = browser.new_context(**options).new_page()
    requested: list[str] = []
    page.on("request", lambda request: requested.append(request.url))
    page.goto(url)
    assert [each for each in requested if not each.startswith((SITE.as_uri(), "data:"))] == []
    return page


def newest() -> Path:
    """Return the folder of the version that the entrance opens."""
    entrance = re.search(r"url=([^/]+)/", (SITE / "index.html").read_text())
    assert entrance is not None
    return SITE / entrance[1]


@built
@in_browser
@pytest.mark.parametrize(
    ("query", "page"),
    [
        ("e-stop", "ros-topics"),
        ("twist_mux", "ros-topics"),
        ("odometry drift", "faults"),
        ("battery", "set-up-a-rover"),
    ],
)
def test_the_search_finds_the_right_page_first(browser: Browser, query: str, page: str) -> None:
    url = f"{(newest() / 'search.html').as_uri()}?{urlencode({'q': query})}"
    found = visit(browser, url).locator("#search-results .search li a")
    found.first.wait_for()
    links = found.evaluate_all("links => links.map(link => link.href)")
    assert Path(urlsplit(links[0]).path).stem == page, links[:5]


@built
@in_browser
@pytest.mark.parametrize(
    "page", ["README", *ENTRANCES.values(), "docs/comparison", "docs/site/api"]
)
@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 1040, 390])
def test_pages_fit_in_both_themes(browser: Browser, page: str, theme: Any, width: int) -> None:
    size: Any = {"width": width, "height": 900}
    url = (newest() / f"{page}.html").as_uri()
    shown = visit(browser, url, color_scheme=theme, viewport=size, reduced_motion="reduce")
    name = f"site-{Path(page).stem}-{theme}-{width}.png"
    shown.screenshot(path=ARTIFACTS / name)
    assert shown.evaluate("document.documentElement.scrollWidth") <= width
    red, green, blue = map(int, re.findall(r"\d+", shown.evaluate(BACKGROUND))[:3])
    assert (red + green + blue > 3 * 128) == (theme == "light")


@built
@in_browser
def test_the_list_of_versions_opens_each(browser: Browser) -> None:
    page = visit(browser, (newest() / "docs" / "why.html").as_uri())
    options = page.locator("#versions option")
    folders = {path.parent.name for path in SITE.glob("[!.]*/.buildinfo")}
    assert set(options.all_text_contents()) == folders
    page.evaluate("document.querySelector('#versions').dispatchEvent(new Event('change'))")
    page.wait_for_url((newest() / "README.html").as_uri())
