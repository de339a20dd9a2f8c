"""Times and lanes of the pages, without a browser: the modules run in Node.js."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest
from playwright import __file__ as playwright

from tests.docs.pages import CHECKOUT

NODE = Path(playwright).parent / "driver" / "node"
APP = CHECKOUT / "adapters/console/static/app"
NOW_S = 1_795_989_203.0
"""2026-11-29 21:53:23 UTC."""
SCRIPT = """
const [folder, now_s, given] = process.argv.slice(1);
Date.now = () => 1000 * Number(now_s) - 5e7;
const { serverClock } = await import(`${folder}/model/server_clock.mjs`);
serverClock.offset_s = 5e4;
const modules = {};
for (const name of ["format", "views/strip_lanes"])
    Object.assign(modules, await import(`${folder}/${name}.mjs`));
console.log(JSON.stringify(JSON.parse(given).map(([name, ...args]) => modules[name](...args))));
"""


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the modules, named as modules for any Node.js."""
    folder = tmp_path_factory.mktemp("app")
    for file in APP.rglob("*.js"):
        module = (folder / file.relative_to(APP)).with_suffix(".mjs")
        module.parent.mkdir(parents=True, exist_ok=True)
        module.write_text(file.read_text(encoding="utf-8").replace('.js"', '.mjs"'), "utf-8")
    return folder


def called(app: Path, *calls: list[Any]) -> list[Any]:
    """Return the results of functions, each given with its arguments, at `NOW_S`."""
    command = (NODE, "--input-type=module", "-e", SCRIPT, app, str(NOW_S), json.dumps(calls))
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found: list[Any] = json.loads(done.stdout)
    return found


def test_a_time_has_a_date_unless_it_is_of_today_by_the_clock_of_the_console(app: Path) -> None:
    midnight = NOW_S - 21 * 3600 - 53 * 60 - 23
    assert called(
        app,
        ["clock", NOW_S],
        ["clock", midnight - 0.5, True],
        ["clock", NOW_S + 86_340.0],
        ["interval", midnight - 60.0, midnight - 1.0],
        ["interval", midnight - 60.0, midnight],
        ["interval", NOW_S, NOW_S + 86_340.0],
    ) == [
        "21:53:23",
        "2026-11-28 23:59:59.500",
        "2026-11-30 21:52:23",
        "2026-11-28 23:59:00 to 23:59:59",
        "2026-11-28 23:59:00 to 00:00:00",
        "21:53:23 to 2026-11-30 21:52:23",
    ]


def test_a_long_duration_has_two_units(app: Path) -> None:
    seconds = [0.2, 59.0, 3600.0, 7200.0, 86_399.0, 172_800.0, 190_000.0]
    assert called(app, *(["duration", each] for each in seconds)) == [
        *("0 s", "59 s", "60 min", "2 h", "23 h 59 min", "2 d", "2 d 4 h"),
    ]


def progress(utc: float, status: str, node: str | None, link: str = "direct") -> dict[str, Any]:
    return {"plan": "traverse", "utc": utc, "status": status, "node": node, "link": link}


def test_equal_activities_of_a_plan_are_one_bar(app: Path) -> None:
    reports = [
        progress(1.0, "SUBMITTED", None),
        *[progress(5.0, "EXECUTING", node, link)
          for link in ("direct", "relay") for node in (None, "traverse/wp1")],
        progress(8.0, "EXECUTING", "traverse/wp1", "relay"),
        progress(9.0, "EXECUTING", "traverse/wp2"),
        progress(12.0, "COMPLETED", None),
    ]  # fmt: skip
    other = [{**each, "plan": "survey"} for each in (reports[0], reports[-1])]
    records = {"modes": [], "authority": [], "plans": [*reports, *other]}
    asset: dict[str, list[str]] = {"commands": [], "lastCommands": []}
    history = {"records": records, "alarms": []}
    # The commands of an asset are a Map; an empty list has `values()`, too.
    (lanes,) = called(app, ["lanesOf", asset, history, 20.0])
    bars = [(each["label"], each["parts"][0]["from"], each["row"]) for each in lanes[0]["bars"]]
    assert bars == [
        ("traverse: submitted", 1, 0),
        ("traverse: wp1", 5, 0),
        ("traverse: wp2", 9, 0),
        ("traverse: completed", 12, 0),
        ("survey: submitted", 1, 1),
        ("survey: completed", 12, 1),
    ]
    assert len({each["key"] for each in lanes[0]["bars"]}) == len(bars)
