"""The browser that the tests of a process share."""

import signal

import pytest

from tests.console import site
from tests.support.browser import BROWSER, REQUIRED

pytestmark = pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium")


async def test_a_browser_that_died_is_replaced() -> None:
    for _ in range(2):
        async with site.open_browser() as browser:
            page = await browser.new_page()
            await page.goto("data:text/html,<title>open</title>")
            assert await page.title() == "open"
        process, _ = site._shared_browser()
        process.send(signal.SIGKILL)
        process.ended()
