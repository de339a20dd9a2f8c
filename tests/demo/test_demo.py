"""`rover demo` as people start it: real processes, real sockets, real time."""

import json
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.request import urlopen
from xml.etree import ElementTree

import psutil
import pytest
from PIL import Image

from executive.settings import config_folder
from sim.scenario.expect_commands import LifecycleExpectation
from sim.scenario.reading import load_scenario
from tests.conftest import port_of
from tests.demo.conftest import LIMIT_S, ROVER, Demo, Played, Ran

END_S = 60
JACKAL = load_scenario(str(config_folder() / "demo/jackal.yaml"))

pytestmark = [pytest.mark.busy, pytest.mark.ros, pytest.mark.slow]


@pytest.fixture
def demo(tmp_path: Path, patient: Path) -> Iterator[Demo]:
    """Give a demonstration that has begun to drive, and clean up after it."""
    running = Demo(tmp_path / "run", patient)
    try:
        running.wait_for("STARTED")
        yield running
    finally:
        running.clean_up()


@pytest.fixture
def ran(played: Played) -> Ran:
    """Give the demonstration of the Jackal."""
    return played.jackal


def test_table_shows_the_life_cycle_of_every_command(ran: Ran) -> None:
    table = ran.output[ran.output.index(" #  command") :]
    rows = re.findall(r"^ ?(\d+)  .*?(EXECUTED|CANCELLED|REJECTED|DUPLICATE)", table, re.MULTILINE)
    ends = [each.ends for each in JACKAL.expect if isinstance(each, LifecycleExpectation)]
    expected = [*(end.name for end in ends if end is not None), "DUPLICATE"]
    assert rows == [(str(number), end) for number, end in enumerate(expected, 1)]
    first = table.splitlines()[1]
    assert len(re.findall(r"\d+\.\d\d", first)) == 4, "received, accepted, started, ended"


def test_true_error_and_first_motion_are_reported(ran: Ran) -> None:
    error = re.search(r"true error at the last waypoint\s+([\d.]+) cm, ([\d.]+)°", ran.output)
    assert error is not None, ran.output
    assert 0 < float(error[1]) < 10
    assert float(error[2]) < 5
    assert re.search(r"first motion\s+\d+\.\d s after the start", ran.output)


def test_every_listed_file_exists(ran: Ran) -> None:
    reported = ran.output[ran.output.index(f"Files in {ran.folder}") :].partition("\n\n")[0]
    names = [
        name.strip(",")
        for line in reported.splitlines()[1:]
        for name in line.split("  ")[0].split()
    ]
    assert len(names) == 13
    assert [name for name in names if not (ran.folder / name).exists()] == []


def test_pictures_decode(ran: Ran) -> None:
    with Image.open(ran.folder / "picture.jpg") as picture:
        picture.load()
        assert (picture.format, picture.size) == ("JPEG", (640, 480))
        shades = picture.convert("L").getcolors()
        assert shades is not None
        assert len(shades) > 50, "there is something to see"
    with Image.open(ran.folder / "map.png") as picture:
        picture.load()
        assert picture.format == "PNG"


def test_drawings_parse(ran: Ran) -> None:
    drawing = (ran.folder / "map.svg").read_text()
    texts = [
        element.text or "" for element in ElementTree.fromstring(drawing).iter() if element.text
    ]
    assert any(text.startswith("true error at the last target") for text in texts)
    tree = ElementTree.fromstring((ran.folder / "tree.svg").read_text())
    labels = " ".join(element.text or "" for element in tree.iter())
    assert labels.count("●") > 6, "the tree is drawn while it works"


def test_reports_are_without_gaps(ran: Ran) -> None:
    lines = (ran.folder / "reports.jsonl").read_text().splitlines()
    reports = [json.loads(line) for line in lines]
    numbers = list(dict.fromkeys(report["sequence"] for report in reports))
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    ended = {r["label"] for r in reports if r["stage"] in {"EXECUTED", "CANCELLED", "REJECTED"}}
    assert len(ended) == len(JACKAL.timeline) - 1, "the one sent twice has one life"
    assert all(report["link"] == "direct" for report in reports)
    # Both are of one clock; on a busy computer their conversions differ by tenths of a second.
    assert all(report["received_s"] > report["time_s"] - 1.0 for report in reports)


def test_a_process_that_dies_is_named_with_its_log(demo: Demo) -> None:
    demo.child("adapters.onboard.process").kill()
    status, output = demo.end()
    assert status == 1
    assert "Error: the executive process ended by SIGKILL" in output
    assert "STARTED moveTo" in output, "the tail of its log"
    assert "Traceback" not in output
    _, alive = psutil.wait_procs(demo.others(), timeout=END_S)
    assert alive == []


def test_nothing_is_left_when_it_is_killed(demo: Demo) -> None:
    others = demo.others()
    assert len(others) == 5, (
        "the simulation, the executive, its guard and that one's supervisor, the console"
    )
    demo.process.kill()
    _, alive = psutil.wait_procs(others, timeout=END_S)
    assert alive == []


def test_a_console_shows_the_rover_until_ctrl_c_ends_all(demo: Demo) -> None:
    printed = demo.wait_for("STARTED")
    (address,) = re.findall(r"http://127.0.0.1:\d+/", printed)
    assert printed.index(address) < printed.index("ready after"), "before the session"
    assert "--paced" in demo.child("sim.ros.process").cmdline()
    names: set[str] = set()
    deadline_s = time.monotonic() + END_S
    while "moveTo" not in names:
        assert time.monotonic() < deadline_s, names
        with urlopen(f"{address}api/commands") as answer:
            names = {each["name"] for each in json.load(answer)["commands"]}
    demo.process.send_signal(signal.SIGINT)
    status, output = demo.end()
    assert status == 130
    assert "Interrupted." in output
    assert "Traceback" not in output
    assert demo.others() == []


def rover(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [ROVER, *arguments], capture_output=True, text=True, timeout=LIMIT_S, check=False
    )


def test_a_non_empty_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("keep")
    refused = rover("demo", "--out", str(tmp_path))
    assert refused.returncode == 2
    assert "is not empty" in refused.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def went_well(ran: Ran) -> bool:
    """Return whether all went as planned and nothing is left."""
    assert ran.status == 0, ran.output
    return ran.left == []


def draws_a_timeline(ran: Ran, folder: Path) -> bool:
    reported = "each command between ground, orbiter and rover" in ran.output
    return reported and (folder / "timeline.png").stat().st_size > 0


def stages(folder: Path, link: str) -> dict[str, list[str]]:
    """Return the stages of each command that were told by a link, in their order."""
    reported: dict[str, list[str]] = {}
    numbers: set[int] = set()
    for line in (folder / "reports.jsonl").read_text().splitlines():
        report = json.loads(line)
        if report["link"] != link or report["sequence"] in numbers:
            continue  # to a repeat the rover reports the last stage again
        numbers.add(report["sequence"])
        if report["stage"] not in (None, "PROGRESS"):
            reported.setdefault(report["label"], []).append(report["stage"])
    return reported


def test_a_rover_in_an_eclipse_does_as_planned(played: Played) -> None:
    ran = played.relay
    assert went_well(ran)
    assert draws_a_timeline(ran, ran.folder)
    assert "no contact, next in" in ran.output
    assert re.search("commands queued at the orbiter +[2-6] of 6", ran.output), ran.output
    assert "its lifetime ended at the orbiter" in ran.output


def test_jackal_and_mocup_do_as_planned(played: Played) -> None:
    for ran in (played.jackal, played.mocup):
        assert went_well(ran)
        assert (ran.folder / "map.png").stat().st_size > 0
    assert (played.mocup.folder / "nxt.log").is_file()


def test_a_command_by_both_links_is_executed_once_by_either_rover(
    tmp_path: Path, patient: Path
) -> None:
    ran = Demo(tmp_path / "run", patient, "--assets", "--no-console").ran()
    assert went_well(ran)
    assert ran.output.count("executed once") == 2
    for asset in ("jackal", "mocup"):
        folder = ran.folder / asset
        assert (folder / "map.png").stat().st_size > 0
        assert draws_a_timeline(ran, folder)
        direct, relay = stages(folder, "direct"), stages(folder, "relay")
        assert direct["home"].count("STARTED") == 1
        assert direct["home"][-1] == relay["home"][-1] == "EXECUTED"


def test_commands_pass_through_a_link_with_light_time(
    tmp_path: Path, patient: Path, ros_domain: int
) -> None:
    to = f"127.0.0.1:{port_of(ros_domain)}"
    options = ("--no-session", "--no-console", "--delay", "2s", "--port", to.split(":")[1])
    demo = Demo(tmp_path / "run", patient, *options)
    try:
        assert f"status --to {to} --delay 2s" in demo.wait_for("Ctrl-C ends it.")
        status = rover("status", "--json", "--to", to, "--delay", "2s")
        assert 2.0 <= json.loads(status.stdout)["roundTrip"] < 4.0, status.stderr
        stop = rover("stop", "--to", to, "--delay", "2s")
        assert (stop.returncode, "EXECUTED" in stop.stdout) == (0, True), stop.stderr
        demo.process.send_signal(signal.SIGINT)
        assert demo.end()[0] == 0
        assert demo.others() == []
    finally:
        demo.clean_up()
