"""A recording in a real browser."""

import gzip
import re
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from adapters.recording import RunFile, RunReader, decode
from executive.core.recording import TelemetrySent
from tests.conftest import port_of
from tests.console.site import Site, Visitors, visitors
from tests.console.test_browser import commands, picture
from tests.console.test_theme_page import AXE, VIOLATIONS
from tests.support.browser import BROWSER, REQUIRED

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]

FORK_MS = 60_000
RECORDING = "rover:rovers/rover:jackal%40run/rover:jackal%40run"


@pytest.fixture(scope="module")
def people() -> Iterator[Visitors]:
    """Give browsers; nothing may fail on any page."""
    with visitors() as people:
        yield people
    assert people.errors == []
    assert people.requests == []


@pytest.fixture(scope="module")
def page(
    module_ros_domain: int,
    drive: Path,
    people: Visitors,
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Page]:
    """Give the page of a recording that was opened in the browser, at a console without a rover."""
    absent = f"maltcp://127.0.0.1:{port_of(module_ros_domain)}/MRS"
    site = Site(tmp_path_factory.mktemp("console"), port_of(module_ros_domain), absent)
    with site.console():
        page = people.visit(site.url, "anna")
        file = page.get_by_label("file of a recording")
        file.set_input_files({"name": "a.mcap", "mimeType": "", "buffer": b"not at all"})
        expect(page.get_by_text("a.mcap: is no MCAP file, or damaged")).to_be_visible()
        file.set_input_files(drive)
        expect(page.get_by_label("moment")).to_be_visible()
        yield page


def test_a_recording_is_displayed_in_the_same_views_and_not_commanded(page: Page) -> None:
    expect(page.get_by_test_id("mode")).to_have_text("RECORDING")
    for kind in ("takePicture", "rotateBy", "moveForward"):
        expect(commands(page, kind)).to_have_attribute("data-state", "executed")
    marker = page.get_by_test_id("rover")
    expect(marker).to_have_attribute("data-x", re.compile(r"^3\.0"))

    expect(commands(page, "rotateBy")).to_contain_text("angle 90°")
    expect(page.locator(".values tr").filter(has_text="Battery voltage")).to_contain_text(
        re.compile(r"Battery voltage.*V")
    )

    page.get_by_label("moment").fill("3.5")
    expect(marker).to_have_attribute("data-x", re.compile(r"^[12]\."))
    why = page.locator(".tree-view .why")
    expect(why).to_have_text(re.compile(r"^as of .*for MOE:1 moveForward$"))
    expect(page.locator(".tree [data-status=running]").filter(has_text="drive")).to_be_visible()
    drive = commands(page, "moveForward")
    expect(drive).to_have_attribute("data-state", "started")
    expect(drive.locator("[data-stage=STARTED]")).to_have_attribute("data-reached", "true")
    expect(drive.locator("[data-stage=EXECUTED]")).to_have_attribute("data-reached", "false")
    expect(page.get_by_test_id("value-POS_X")).to_have_text(re.compile(r"^[12]\."))
    expect(page.locator(".log-view .line:not(.later)")).to_have_count(4)
    page.screenshot(path=picture("console-recording"))
    with page.expect_popup() as opened:
        page.locator(".c-frame, .l-layout__frame").filter(has_text="Behaviour tree").get_by_title(
            "Help"
        ).click()
    expect(opened.value.get_by_role("heading", level=1)).to_have_text("Watch the behaviour tree")
    opened.value.close()

    expect(page.get_by_test_id("stop")).to_be_hidden()
    expect(page.get_by_label("command", exact=True)).to_have_count(0)
    page.keyboard.press("F8")
    expect(page.get_by_text("is a recording: choose the rover to stop")).to_be_visible()


def test_a_leaf_selects_its_command_of_the_moment(page: Page) -> None:
    leaf = page.locator(".tree .name").filter(has_text="turn to heading")
    page.get_by_label("find a node").fill("turn to heading")
    for moment, name in (("3.5", "moveForward"), ("5.0", "rotateBy")):
        page.get_by_label("moment").fill(moment)
        why = page.locator(".tree-view .why")
        expect(why).to_have_text(re.compile(f"{name}$", re.IGNORECASE))
        leaf.click()
        chosen = page.locator(".command.selected")
        expect(chosen).to_have_count(1)
        expect(chosen).to_have_attribute("data-name", name)
        lines = page.locator(".log-view .line.selected")
        expect(lines.filter(has_text=re.compile(name, re.IGNORECASE))).not_to_have_count(0)
        assert lines.filter(has_not_text=re.compile(name, re.IGNORECASE)).count() == 0
        expect(page.locator(".map polyline.marked[points*=',']")).to_be_attached()
        leaf.click()
        expect(chosen).to_have_count(0)
    page.get_by_label("find a node").fill("")


def test_a_command_selects_its_nodes(page: Page) -> None:
    for name, leaf in (("moveForward", "drive"), ("takePicture", "capture")):
        command = commands(page, name)
        command.locator(".head").click()
        expect(page.locator(".tree g.selected").filter(has_text=leaf)).to_be_visible()
        expect(page.locator(".tree g.selected").filter(has_text="velocity")).to_have_count(0)
        command.locator(".head").click()


def test_a_fork_is_displayed_beside_the_recording(page: Page) -> None:
    """With the engine: a slower drive, and another command at the time of the slider."""
    result = page.get_by_test_id("fork")
    page.get_by_role("button", name="fork here").click()
    expect(result).to_contain_text("a change is needed")
    page.get_by_label("setting", exact=True).fill("drive.no_such_key=0.6")
    page.get_by_role("button", name="fork here").click()
    expect(result).to_contain_text("no_such_key", timeout=FORK_MS)

    page.get_by_label("setting", exact=True).fill("drive.travel_speed_mps=0.3")
    page.get_by_role("button", name="fork here").click()
    expect(result).to_have_attribute("data-fidelity", "BIT_EQUAL", timeout=FORK_MS)
    expect(result).to_contain_text(re.compile(r"First difference after [\d.]+ s: "))
    row = result.locator("tr[data-command='MOE:1']")
    ends = [float(each) for each in re.findall(r"EXECUTED ([\d.]+) s", row.inner_text())]
    assert len(ends) == 2
    assert ends[1] > ends[0] + 2.0, "at 0.3 m/s 3 m take longer"
    expect(page.get_by_test_id("fork-track")).to_be_attached()
    page.screenshot(path=picture("console-fork"))
    page.evaluate(gzip.decompress(AXE.read_bytes()).decode())
    assert page.evaluate(VIOLATIONS.replace(".rover-view", ".recording-view")) == []

    page.get_by_label("moment").fill("2.0")
    page.get_by_label("setting", exact=True).fill("")
    page.get_by_label("command at this time").fill("stop")
    page.get_by_role("button", name="fork here").click()
    expect(row).to_contain_text("CANCELLED STOPPED 2.0", timeout=FORK_MS)
    expect(result).to_contain_text("First difference after 2.0")


def test_a_recording_has_its_telemetry_and_is_closed(page: Page) -> None:
    layout = page.evaluate("location.hash")
    with page.expect_response(re.compile("/api/tm/jackal%40run/POS_X.*minmax")) as plotted:
        page.evaluate(f"location.hash = '#/browse/{RECORDING}~telemetry~recording~POS_X'")
    assert len(plotted.value.json()["samples"]) == 7
    # Open MCT writes the span that is looked at into the address, a moment after it came there.
    page.wait_for_url(re.compile("POS_X.*tc[.]startBound"))
    page.evaluate("hash => { location.hash = hash }", layout)
    page.get_by_label("OpenMCT Search").get_by_label("Search Input").fill("battery")
    found = page.get_by_label("Search Results Dropdown")
    expect(found.get_by_text("Battery voltage (BATERY_VOLTAGE)")).to_be_visible()
    page.screenshot(path=picture("console-search"))
    page.keyboard.press("Escape")
    page.get_by_role("button", name="close", exact=True).click()
    expect(page.get_by_text("No rover is connected").last).to_be_visible()
    expect(page.get_by_role("treeitem").filter(has_text="jackal@run")).to_have_count(0)


REQUESTED = """
async (sizes) => {
  const { openmct } = window;
  const name = `${encodeURIComponent("jackal@unknown")}~telemetry~recording~POS_X`;
  const object = await openmct.objects.get({ namespace: "rover", key: name });
  const time = { start: 0, end: Date.now() * 10, domain: "utc", strategy: "minmax" };
  const request = (size) => openmct.telemetry.request(object, { ...time, size });
  const found = await Promise.all(sizes.map(request));
  const point = ({ utc, value }) => [utc, Number.isNaN(value) ? null : value];
  return found.map((each) => each.map(point));
}
"""


def test_an_outage_is_a_gap_of_a_plot_at_every_zoom(
    page: Page, drive: Path, tmp_path: Path
) -> None:
    path, reported = tmp_path / "unknown.mcap", 0
    with closing(RunFile(path)) as file:
        for message in RunReader(drive).messages():
            item = decode(message.topic, message.data)
            if isinstance(item, TelemetrySent):
                reported += 1
                if 3 <= reported <= 5:
                    unknown = tuple(replace(each, value=None) for each in item.values)
                    item = replace(item, values=unknown)
            file.put(item)
    page.get_by_label("file of a recording").set_input_files(path)
    expect(page.get_by_label("moment")).to_be_visible()
    for points in page.evaluate(REQUESTED, [1, 2, 3, 100]):
        times, values = zip(*points, strict=True)
        gap = values.index(None)
        assert values.count(None) == 1
        assert 0 < gap < len(values) - 1
        assert times == tuple(sorted(times))
        assert times[gap + 1] - times[gap] >= 3000
    page.evaluate(
        "hash => { location.hash = hash }",
        "#/browse/rover:jackal%40unknown~telemetry~recording~POS_X",
    )
    page.wait_for_url(re.compile("POS_X.*tc[.]startBound"))
    page.screenshot(path=picture("console-outage"))
