"""What a page shows of a rover whose clock was set back."""

from pathlib import Path

import pytest

from tests.console.consoles import at_console
from tests.console.site import open_browser
from tests.support.browser import BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]
SHOWN = """async samples => {
    const { Asset } = await import("/app/model/asset.js");
    const asset = new Asset("rover");
    for (const [key, link, utc, value, q] of samples) {
        asset.addSample({ key, link, utc, rx: utc, value, q });
    }
    const x = asset.newest("POS_X");
    return [x.value, x.utc, x.interval ?? null, asset.pose?.utc ?? null];
}"""

RETAINED = """async count => {
    const { Asset } = await import("/app/model/asset.js");
    const asset = new Asset("rover");
    for (let number = 0; number < count; number++)
        asset.setCommand({ id: `${number}`, number, ended: number > 0, history: [] });
    return [asset.commands.size, ...["0", "1", "2", "3"].map(id => asset.commands.has(id))];
}"""


def fix(utc: float, x: float, q: str = "good", link: str = "direct") -> list[list[object]]:
    return [[key, link, utc, x, q] for key in ("HEAD", "POS_Y", "POS_X")]


async def test_the_newest_value_is_shown_despite_a_clock_set_back(tmp_path: Path) -> None:
    async with (
        at_console(tmp_path, "maltcp://127.0.0.1:1/MRS", "anna") as (anna,),
        open_browser() as browser,
    ):
        page = await browser.new_page()
        await page.goto(f"{anna.address}lite")
        before = [*fix(900.0, 8.0), *fix(901.0, 9.0), *fix(890.0, 7.0, link="relay")]
        late = fix(899.0, 1.0, "late")
        assert await page.evaluate(SHOWN, [*before, *late]) == [9.0, 901.0, 1.0, 901.0]
        back = fix(100.0, 2.0)
        assert await page.evaluate(SHOWN, [*before, *back]) == [2.0, 100.0, None, 100.0]
        after = [*back, *fix(102.0, 3.0), *late]
        assert await page.evaluate(SHOWN, [*before, *after]) == [3.0, 102.0, 2.0, 102.0]
        assert await page.evaluate(RETAINED, 3002) == [3000, True, False, False, True]
