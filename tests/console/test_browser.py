"""The console in a real browser, against a simulated rover over the real services."""

import re
import shutil
import signal
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Locator, Page, expect

from tests.conftest import port_of
from tests.console.site import Site, Visitors, rover, visitors
from tests.docs.pages import CHECKOUT
from tests.support.browser import ARTIFACTS, BROWSER, REQUIRED
from tests.support.ports import free_udp_ports

pytestmark = [
    pytest.mark.busy,
    pytest.mark.ros,
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None and not REQUIRED, reason="needs chromium"),
]

STRIP = "rover:rovers/rover:jackal/rover:jackal~strip"
ZONES = """
zones:
  keep_out: [{name: crater, corners_m: [[1, -3.2], [3, -3.4], [3.4, -1.6], [1.2, -1.4]]}]
  rocks: [{name: boulder, x_m: -1.2, y_m: 1.4, radius_m: 0.4}]
"""


@pytest.fixture(scope="module")
def site(
    module_ros_domain: int, patient: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Site]:
    """Give a console that runs, of a rover whose commands need the authority."""
    folder = tmp_path_factory.mktemp("console")
    config = folder / "config"
    shutil.copytree(patient, config)
    with (config / "jackal.yaml").open("a", encoding="utf-8") as settings:
        settings.write(f"\nauthority: {{needed: true}}{ZONES}")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROVER_CONFIG", str(config))
        camera, ground = free_udp_ports(2)
        with rover(folder, camera, ground) as uri:
            site = Site(folder, port_of(module_ros_domain), uri, ground)
            with site.console():
                yield site


@pytest.fixture(scope="module")
def people() -> Iterator[Visitors]:
    """Give browsers; nothing may fail on any page, and nothing may be asked for elsewhere."""
    with visitors() as people:
        yield people
    assert people.errors == []
    assert people.requests == []


@pytest.fixture(scope="module")
def page(site: Site, people: Visitors) -> Page:
    """Give the whole console, as anna sees it, who holds the authority between tests."""
    page = people.visit(site.url, "anna")
    page.get_by_role("button", name="request", exact=True).click()
    expect(page.get_by_test_id("holder")).to_have_text("you command")
    return page


def test_a_command_is_previewed_sent_and_executed_and_the_rover_moves_on_the_map(
    page: Page,
) -> None:
    marker = page.get_by_test_id("rover")
    expect(marker).to_have_attribute("data-x", re.compile(r"^-?0\.[0-9]+$"))
    click_at(page, 1.0, 0.5)
    expect(page.get_by_label("x", exact=True)).to_have_value(re.compile(r"^(0\.9|1)"))
    expect(page.get_by_test_id("preview")).to_contain_text(re.compile(r"takes [0-9.]+ s"))
    page.screenshot(path=picture("console-preview"))
    page.get_by_role("button", name="Send moveTo to jackal").click()
    command = commands(page, "moveTo").first
    expect(command).to_have_attribute("data-state", "started")
    expect(command.locator("[data-stage=EXECUTED]")).to_have_attribute("data-reached", "false")
    expect(page.locator(".rover-bar .doing")).to_have_text(re.compile(r"^moveTo: .* remaining$"))
    expect(marker).to_have_attribute("data-x", re.compile(r"^0\.[3-9]"))
    page.screenshot(path=picture("console"))
    expect(command).to_have_attribute("data-state", "executed")
    for stage in ("SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"):
        reached = command.locator(f"[data-stage={stage}]")
        expect(reached).to_have_attribute("data-reached", "true")
    expect(marker).to_have_attribute("data-x", re.compile(r"^(0\.9|1\.0)"))
    expect(page.get_by_test_id("outcome")).to_contain_text("predicted")
    command.click()
    for marked in (
        page.locator(".tree g.selected").filter(has_text="drive"),
        page.locator(".log-view .line.selected").filter(has_text="EXECUTED"),
        page.locator(".map polyline.marked[points*=',']"),
    ):
        expect(marked.first).to_be_attached()
    page.screenshot(path=picture("console-executed"))
    command.locator(".head").click()


def test_a_node_of_the_tree_selects_its_command(page: Page) -> None:
    page.get_by_label("find a node").fill("drive")
    page.locator(".tree .name").filter(has_text="drive").click()
    expect(page.locator(".command.selected[data-name=moveTo]")).to_be_visible()
    page.locator(".tree .name").filter(has_text="drive").click()
    page.get_by_label("find a node").fill("")


def test_the_time_strip_shows_activities_by_time_and_selects_them(page: Page) -> None:
    layout = page.evaluate("location.hash")
    page.evaluate(f"location.hash = '#/browse/{STRIP}?hideInspector=true'")
    lanes = page.locator(".strip [data-lane]")
    expect(lanes).to_have_count(6)
    moved = page.locator(".strip .bar[data-state=executed]").filter(has_text="moveTo").last
    expect(moved.locator("rect.started, rect.executed")).to_have_count(1)
    expect(moved.locator(".expected")).to_have_attribute("visibility", "inherit")
    expect(page.locator(".strip [data-lane=mode] .mode-MOVING").first).to_be_attached()
    expect(page.locator(".strip [data-lane=authority]")).to_contain_text("anna")
    page.screenshot(path=picture("console-strip"))
    page.get_by_label("what to export").select_option("commands")
    with page.expect_download() as saving:
        page.get_by_role("button", name="export CSV").click()
    time = r"\d{8}T\d{6}Z"
    name = saving.value.suggested_filename
    assert re.fullmatch(f"jackal_commands_{time}_{time}.csv", name), name
    assert "moveTo" in Path(saving.value.path()).read_text(encoding="utf-8")

    moved.locator("rect").last.click()
    expect(moved).to_have_class(re.compile("selected"))
    strip, bar = page.locator(".strip").bounding_box(), moved.locator("rect").last.bounding_box()
    assert strip is not None
    assert bar is not None
    page.mouse.click(bar["x"] + bar["width"] / 2, strip["y"] + 8)
    expect(page.get_by_test_id("strip-cursor")).to_have_attribute("visibility", "visible")
    page.evaluate("hash => { location.hash = hash }", layout)
    expect(page.locator(".command.selected[data-name=moveTo]")).to_be_visible()
    expect(page.get_by_text("(past)")).to_be_visible()
    page.get_by_role("button", name="back to now").click()
    commands(page, "moveTo").first.locator(".head").click()


def test_map_and_tree_show_how_it_was_at_the_end_of_a_span_of_the_past(page: Page) -> None:
    live = show_past(page, page.evaluate("Date.now() - 1000"))
    expect(page.locator(".tree-view .why")).to_have_text(re.compile("^as of"))
    page.get_by_role("button", name="back to now").click()
    expect(page.get_by_text("(past)")).to_be_hidden()
    page.evaluate("hash => { location.hash = hash }", live)


def test_a_recording_beside_a_rover_is_displayed_in_its_own_time(
    site: Site, drive: Path, people: Visitors
) -> None:
    page = people.visit(f"{site.url}#/browse/rover:rovers?hideInspector=true", "bert")
    page.get_by_label("file of a recording").set_input_files(drive)
    expect(page.get_by_text("(past)")).to_be_visible()
    expect(page.get_by_test_id("stop")).to_be_hidden()
    rovers = page.get_by_role("combobox", name="rover")
    rovers.select_option("jackal")
    expect(page.get_by_text("(past)")).to_be_hidden()
    expect(page.get_by_test_id("stop")).to_be_visible()
    expect(page.get_by_test_id("mode")).to_have_text("IDLE")
    rovers.select_option("jackal@run")
    page.get_by_role("button", name="close", exact=True).click()
    expect(page.get_by_test_id("mode")).to_have_text("IDLE")

    page.evaluate(f"location.hash = '#/browse/{STRIP}?hideInspector=true'")
    moved = page.locator(".strip .bar[data-state=executed]").filter(has_text="moveTo").last
    strip, bar = page.locator(".strip").bounding_box(), moved.locator("rect").last.bounding_box()
    assert strip is not None
    assert bar is not None
    page.mouse.click(bar["x"] + bar["width"] / 2, strip["y"] + 8)
    page.get_by_role("button", name="fork here").click()
    moment = page.get_by_label("moment")
    expect(moment).to_be_visible()
    started = "[data-name=moveTo][data-state=started]"
    expect(page.locator(f".command{started}")).to_be_visible()
    assert float(moment.input_value()) < float(moment.get_attribute("max") or 0.0)
    lite = people.visit(f"{site.url}lite", "bert")
    expect(lite.get_by_label("recordings").get_by_role("link")).to_have_count(1)
    lite.context.close()
    page.get_by_role("button", name="close", exact=True).click()
    page.context.close()


def test_a_plan_from_a_file_is_submitted_and_removed(
    site: Site, page: Page, people: Visitors
) -> None:
    plans = people.visit(f"{site.url}#/browse/rover:rovers/rover:jackal/rover:jackal~plans", "anna")
    declared = '<?xml version="1.0" encoding="ISO-8859-1"?><root name="Gelände"/>'
    plans.get_by_label("file of a plan").set_input_files(
        {"name": "a.xml", "mimeType": "text/xml", "buffer": declared.encode("iso-8859-1")}
    )
    expect(plans.locator(".plans-view textarea")).to_have_value(declared)
    plans.get_by_label("file of a plan").set_input_files(CHECKOUT / "config/plans/look-around.xml")
    plans.get_by_role("button", name="Submit to jackal").click()
    plan = plans.locator(".plans-view tbody tr").filter(has_text="look-around")
    expect(plan).to_contain_text(re.compile("submitted.*by anna, revision 1"))
    plan.get_by_role("button", name="remove").click()
    expect(commands(page, "removePlan").first).to_have_attribute("data-state", "executed")
    plans.context.close()


def test_the_camera_shows_its_video_is_turned_and_takes_a_picture(
    site: Site, page: Page, people: Visitors
) -> None:
    address = f"{site.url}#/browse/rover:rovers/rover:jackal/rover:jackal~"
    camera = people.visit(f"{address}video?hideInspector=true", "anna")
    expect(camera.get_by_text("the rover sends them after")).to_be_visible()
    camera.get_by_role("button", name="video on").click()
    expect(camera.get_by_test_id("video")).to_have_attribute("data-frames", re.compile("^[2-9]"))
    expect(camera.get_by_text(re.compile("[1-9] pictures/s"))).to_be_visible()
    camera.get_by_role("button", name="→").click()
    expect(commands(page, "moveCameraAngles").first).to_have_attribute("data-state", "executed")
    expect(page.get_by_test_id("value-CAM_PAN")).to_have_text(re.compile("^-[1-9]0"))
    camera.screenshot(path=picture("console-camera"))
    camera.get_by_role("button", name="video off").click()
    expect(camera.get_by_text("0 pictures/s")).to_be_visible()
    camera.get_by_role("button", name="take picture").click()
    camera.goto(f"{address}files?hideInspector=true")
    camera.get_by_role("button", name="show", exact=True).first.click()
    expect(camera.get_by_role("figure").locator("img")).to_have_js_property("naturalWidth", 640)
    expect(
        camera.get_by_text(re.compile(r"Position X -?[0-9.]+ m; .*Pan angle .* -[1-9]0"))
    ).to_be_visible()
    camera.get_by_role("button", name="fetch", exact=True).first.click()
    fetched = camera.locator(".transfers [data-state=done]").first
    expect(fetched).to_contain_text(re.compile("pictures/anna-.*jpg.*kB.*anna"))
    with camera.expect_download() as saved:
        fetched.get_by_role("link", name="save").click()
    assert saved.value.path().read_bytes()[:2] == b"\xff\xd8"
    camera.screenshot(path=picture("console-files"))
    camera.context.close()


def test_a_display_of_an_operator_is_stored_for_all(site: Site, people: Visitors) -> None:
    page = people.visit(f"{site.url}#/browse/shared:displays?hideInspector=true", "bert")
    # Once it stands, a view clicks on itself to be selected, which closes any menu.
    expect(page.locator("[s-selected]").first).to_be_attached()
    page.get_by_text("Create", exact=True).first.click()
    page.get_by_role("menuitem", name="Overlay Plot").click()
    page.get_by_label("Title", exact=True).first.fill("Speeds")
    page.get_by_role("button", name="Save", exact=True).click()
    expect(page.get_by_role("main").get_by_text("Speeds")).to_be_visible()
    stored = page.request.get(f"{site.url}api/objects").json()["objects"]
    values = [
        page.request.get(f"{site.url}api/objects/{each['key']}").json()["value"] for each in stored
    ]
    assert ("Speeds", "bert") in [(each["name"], each.get("createdBy")) for each in values]
    page.context.close()


def test_refusals_of_the_rover_and_invalid_input_are_reported(page: Page) -> None:
    choose(page, "moveForward")
    distance = page.get_by_label("distance", exact=True)
    distance.fill("1000")
    expect(page.get_by_text("not in -100 … 100 m")).to_be_visible()
    expect(page.get_by_role("button", name="Send moveForward")).to_be_disabled()
    distance.fill("5")
    expect(page.get_by_test_id("preview")).to_contain_text(re.compile(r"takes [0-9.]+ s"))


def test_the_map_shows_how_uncertain_the_pose_is_and_was(
    site: Site, page: Page, people: Visitors
) -> None:
    uncertain, pose = page.get_by_test_id("uncertain"), page.locator(".map-view .pose")
    expect(uncertain).to_have_attribute("visibility", "hidden")
    expect(pose).to_contain_text("in odom")
    confirm_pose(page, "0.6", "12")
    expect(uncertain).to_have_attribute("data-position", "0.600")
    expect(uncertain).to_have_attribute("visibility", "visible")
    expect(pose).to_contain_text("uncertain by 0.60 m and 12.0°")
    choose(page, "moveTo")
    page.get_by_label("x", exact=True).fill("2")
    page.get_by_label("y", exact=True).fill("1")
    page.get_by_role("button", name="Send moveTo to jackal").click()
    refused = commands(page, "moveTo").first
    expect(refused).to_have_attribute("data-state", "rejected")
    expect(refused).to_contain_text("the heading is uncertain by 12.0°")
    page.screenshot(path=picture("console-uncertain"))
    then_ms = page.evaluate("Date.now()")
    light = people.visit(f"{site.url}lite", "bert", (420, 800))
    expect(light.locator(".map-view .pose")).to_contain_text("uncertain by 0.60 m and 12.0°")
    light.screenshot(path=picture("console-uncertain-light"))
    light.context.close()
    confirm_pose(page, "0", "0")
    expect(uncertain).to_have_attribute("visibility", "hidden")
    live = show_past(page, then_ms)
    expect(pose).to_contain_text("uncertain by 0.60 m and 12.0°")
    expect(uncertain).to_have_attribute("visibility", "visible")
    page.get_by_role("button", name="back to now").click()
    expect(uncertain).to_have_attribute("visibility", "hidden")
    page.evaluate("hash => { location.hash = hash }", live)


def test_a_second_console_is_refused_and_then_granted(
    site: Site, page: Page, people: Visitors
) -> None:
    other = people.visit(f"{site.url}lite", "bert")
    expect(other.get_by_test_id("holder")).to_have_text("anna commands")
    choose(other, "rotateBy")
    other.get_by_label("angle", exact=True).fill("10")
    expect(other.get_by_text("anna commands: request the authority above")).to_be_visible()
    refused = other.request.post(
        f"{site.url}api/commands",
        headers={"X-Rover-Operator": "bert"},
        data={"id": "bert-1", "asset": "jackal", "name": "rotateBy", "args": {"angle": 0.1}},
    )
    assert (refused.status, refused.json()["holder"]) == (403, "anna")
    other.get_by_role("button", name="request", exact=True).click()
    page.get_by_role("button", name="hand over to bert").click()
    expect(other.get_by_test_id("holder")).to_have_text("you command")
    other.get_by_role("button", name="Send rotateBy to jackal").click()
    expect(commands(page, "rotateBy").first).to_have_attribute("data-state", "executed")
    page.get_by_role("button", name="request", exact=True).click()
    other.get_by_role("button", name="hand over to anna").click()
    expect(page.get_by_test_id("holder")).to_have_text("you command")
    other.context.close()


def test_a_stop_without_authority_stops_the_rover(site: Site, page: Page, people: Visitors) -> None:
    other = people.visit(f"{site.url}lite", "bert")
    choose(page, "moveForward")
    page.get_by_label("distance", exact=True).fill("20")
    page.get_by_role("button", name="Send moveForward to jackal").click()
    moving = commands(other, "moveForward").first
    expect(moving).to_have_attribute("data-state", "started")
    other.keyboard.press("F8")
    expect(moving).to_have_attribute("data-state", "cancelled")
    expect(page.get_by_test_id("mode")).to_have_text("STOPPED")
    expect(page.get_by_test_id("holder")).to_have_text("you command")
    other.screenshot(path=picture("console-light"))
    page.get_by_role("button", name="release the stop").click()
    expect(page.get_by_test_id("mode")).to_have_text("IDLE")
    other.context.close()


def test_the_light_page_loads_without_open_mct(site: Site, people: Visitors) -> None:
    requested: list[str] = []
    page = people.visit("about:blank", "bert", (420, 800))
    page.on("request", lambda request: requested.append(request.url))
    page.goto(f"{site.url}lite")
    expect(page.get_by_test_id("value-POS_X")).to_have_text(re.compile(r"^-?[0-9.]+$"))
    expect(page.get_by_test_id("stop")).to_be_visible()
    assert not [url for url in requested if "vendor" in url]
    page.screenshot(path=picture("console-light-narrow"))
    page.context.close()


def test_a_page_recovers_by_itself_when_the_console_was_killed(
    site: Site, people: Visitors, module_ros_domain: int
) -> None:
    own = Site(site.folder / "killed", port_of(module_ros_domain), site.to)
    own.folder.mkdir()
    with own.console() as process:
        page = people.visit(own.url, "anna")
        received = page.get_by_test_id("value-POS_X")
        expect(received).to_have_text(re.compile(r"^-?[0-9.]+$"))
        process.end(signal.SIGKILL)
    lost = page.get_by_text("No connection to rover-console")
    expect(lost).to_be_visible()
    expect(page.locator(".map-view.stale")).to_be_visible()
    people.errors.clear()  # a browser writes each attempt to connect to its console
    with own.console():
        expect(lost).to_be_hidden()
        before = received.get_attribute("title")
        expect(received).not_to_have_attribute("title", before or "")
        page.context.close()


def test_a_console_without_a_rover_shows_how_to_start_one(
    site: Site, people: Visitors, module_ros_domain: int
) -> None:
    absent = f"maltcp://127.0.0.1:{port_of(module_ros_domain)}/MRS"
    own = Site(site.folder / "alone", port_of(module_ros_domain), absent)
    own.folder.mkdir()
    with own.console():
        for path in ("", "lite"):
            page = people.visit(f"{own.url}{path}", "anna")
            expect(page.get_by_text("rover demo --stay").first).to_be_visible()
            page.screenshot(path=picture(f"console-empty{path and '-light'}"))
            page.context.close()


def test_the_served_files_are_light_enough_for_a_first_visit(site: Site) -> None:
    request = urllib.request.Request(
        f"{site.url}vendor/openmct/openmct.js", headers={"Accept-Encoding": "gzip"}
    )
    with urllib.request.urlopen(request) as answer:
        assert answer.headers["Content-Encoding"] == "gzip"
        assert int(answer.headers["Content-Length"]) < 1.2e6


def click_at(page: Page, x_m: float, y_m: float) -> None:
    """Click the map at a place, as it is drawn around the rover."""
    marker = page.get_by_test_id("rover")
    box = page.locator("svg.map").bounding_box()
    assert box is not None
    here = [float(marker.get_attribute(f"data-{axis}") or "nan") for axis in "xy"]
    scale = float(page.locator("svg.map").get_attribute("data-scale") or "nan")
    page.mouse.click(
        box["x"] + box["width"] / 2 + (x_m - here[0]) * scale,
        box["y"] + box["height"] / 2 - (y_m - here[1]) * scale,
    )


def show_past(page: Page, utc_ms: float) -> str:
    """Look at the minute that ends at a moment; return the address of what was looked at."""
    live: str = page.evaluate("location.hash")
    page.evaluate(
        """([hash, end]) => {
            location.hash = `${hash.split('?')[0]}?tc.mode=fixed&tc.timeSystem=utc`
                + `&tc.startBound=${end - 60000}&tc.endBound=${end}`
        }""",
        [live, utc_ms],
    )
    expect(page.get_by_text("(past)")).to_be_visible()
    return live


def confirm_pose(page: Page, position: str, heading: str) -> None:
    choose(page, "confirmPose")
    page.get_by_label("position", exact=True).fill(position)
    page.get_by_label("heading", exact=True).fill(heading)
    page.get_by_role("button", name="Send confirmPose to jackal").click()


def choose(page: Page, command: str) -> None:
    page.get_by_label("command", exact=True).select_option(command)


def commands(page: Page, name: str) -> Locator:
    return page.locator(f".command[data-name={name}]")


def picture(name: str) -> Path:
    ARTIFACTS.mkdir(parents=True, exist_ok=True)
    return ARTIFACTS / f"{name}.png"
