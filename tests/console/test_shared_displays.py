"""Displays in two browsers at two consoles that use one database."""

from pathlib import Path
from typing import Any

import pytest
from playwright.async_api import Page, expect

from tests.console.conftest import Launch
from tests.console.consoles import Operator
from tests.console.postgres import fresh
from tests.console.site import open_browser
from tests.console.test_shared_archive import two_consoles
from tests.support.browser import BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
MUTATE = """async ([key, field, value]) => {
    const { openmct } = window;
    const object = await openmct.objects.get({ namespace: "shared", key });
    const mutable = openmct.objects.toMutable(object);
    openmct.objects.mutate(mutable, field, value);
}"""
TEXT = {"type": "text-view", "x": 1, "y": 1, "width": 30, "height": 5, "fill": "", "stroke": "",
        "color": "", "fontSize": "default", "font": "default", "id": "t1"}  # fmt: skip

FOLDER = {"name": "Displays", "type": "folder", "location": "ROOT"}


def layout(text: str) -> dict[str, Any]:
    return {"items": [TEXT | {"text": text}], "layoutGrid": [10, 10], "objectStyles": {}}


async def retain(operator: Operator, key: str, **value: Any) -> None:
    made = {"identifier": {"namespace": "shared", "key": key}, "modified": 1, "persisted": 1}
    status, answer = await operator.request(
        "PUT", f"api/objects/{key}", json={"value": made | value}, headers={"If-None-Match": "*"}
    )
    assert status == 200, answer


async def test_a_display_that_is_changed_at_one_is_shown_so_at_the_other(
    launch: Launch, postgres: str, tmp_path: Path
) -> None:
    errors: list[str] = []
    async with (
        two_consoles(launch(), fresh(postgres), tmp_path) as (anna, ben),
        open_browser() as browser,
    ):
        members = [{"namespace": "shared", "key": "layout"}]
        await retain(
            anna, "displays", name="Displays", type="folder", location="ROOT", composition=members
        )
        shown = {"name": "Mine", "type": "layout", "location": "shared:displays", "composition": []}
        await retain(anna, "layout", **shown, configuration=layout("before"))
        pages: list[Page] = []
        for each in (anna, ben):
            page = await browser.new_page(viewport={"width": 1200, "height": 700})
            page.on("pageerror", lambda error: errors.append(str(error)))
            await page.goto(f"{each.address}#/browse/shared:displays/shared:layout")
            await expect(page.get_by_text("before")).to_be_visible()
            pages.append(page)
        one, other = pages
        await one.evaluate(MUTATE, ["layout", "configuration", layout("after")])
        await expect(other.get_by_text("after")).to_be_visible()
        await one.evaluate(MUTATE, ["layout", "name", "Ours"])
        await expect(other.locator(".l-browse-bar__object-name")).to_have_text("Ours")
        await other.evaluate(MUTATE, ["layout", "configuration", layout("back again")])
        await expect(one.get_by_text("back again")).to_be_visible()
        for page in pages:
            await page.goto(f"{page.url.split('#')[0]}#/browse/shared:displays")
        await retain(
            anna, "second", name="Second", type="folder", location="shared:displays", composition=[]
        )
        second = {"namespace": "shared", "key": "second"}
        await one.evaluate(MUTATE, ["displays", "composition", [*members, second]])
        for page in pages:
            await expect(page.get_by_text("Second").first).to_be_visible()
    assert errors == []
