"""Every kind of expectation can hold, and can fail."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from executive.commands import Mode
from executive.values.geometry import Pose
from executive.values.reports import Identity, Stage
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import Scenario
from sim.scenario.outcome import judge
from sim.scenario.reading import load_scenario
from sim.scenario.record import Check, Datagram, Fetched, ModeSample, Record, TruePose

RUN = """
title: A metre, a stop, a picture
settings: {camera: {width: 64, height: 48}, status_interval: 0.2}
duration: 6
timeline:
  - {at: 0.5, command: {moveForward: {distance: 1}}, label: ahead}
  - {after: ahead EXECUTED, command: takePicture, label: look}
  - {after: ahead EXECUTED, command: {rotateBy: {angle: 90deg}}, label: turn, lifetime: 9}
  - {after: turn STARTED + 0.5, command: stop}
  - {after: stop EXECUTED, query: there}
  - {after: look EXECUTED + 0.1, fetch: pictures/MOE-2.jpg}
  - {after: look EXECUTED + 0.1, fetch: none.jpg}
  - {after: stop EXECUTED + 0.5, repeat: stop}
  - {at: 5, command: {submitPlan: {plan: look-around, id: tour}}, label: later}
expect:
"""


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scenario, Record]:
    folder = tmp_path_factory.mktemp("run")
    scenario = read(folder, "{pictures: 1}")
    return scenario, run_in_lock_step(scenario, folder)


def read(folder: Path, expectation: str) -> Scenario:
    path = folder / "scenario.yaml"
    path.write_text(f"{RUN}  - {expectation}\n")
    return load_scenario(str(path))


def verdict(folder: Path, expectation: str, record: Record) -> Check:
    return judge(read(folder, expectation), record)[0]


@pytest.mark.parametrize(
    ("expectation", "holding", "failing", "seen"),
    [
        ("command: ahead, ends: %", "EXECUTED", "FAILED", "ends EXECUTED"),
        ("command: turn, stages: [RECEIVED, ACCEPTED, STARTED%]", ", CANCELLED", "", "CANCELLED"),
        ("command: turn, reason: %", "STOPPED", "802", "801 STOPPED: stopped by MOE:4"),
        ("command: ahead, within: %", "3", "1", "after 2."),
        ("command: stop, answers: [%]", "accepted, duplicate", "accepted", "accepted duplicate"),
        ("event: %", "902, count: 0", "ODOMETRY_STALE", "0 ×"),
        ("pose: {x: 1, y: %}, tolerance: 0.05, after: ahead EXECUTED", "0", "0.1", "0.100 m off"),
        (
            "pose: {x: 1, y: 0, heading: %}, tolerance: 1, after: ahead EXECUTED",
            "0",
            "9deg",
            "° off",
        ),
        ("rover: stationary, after: %, for: 1", "stop EXECUTED + 0.2", "ahead STARTED", "went 0."),
        ("rover: moving, % for: 1", "after: ahead STARTED,", "", "went 0.000 m"),
        ("mode: %", "STOPPED", "IDLE", "STOPPED"),
        ("mode: MOVING, %", "after: ahead STARTED", "at: 0.2", "IDLE"),
        ("parameter: POS_X, value: %, tolerance: 0.05, after: ahead EXECUTED", "1", "2", " m"),
        ("parameter: TRAVEL_SPEED, value: %, for: 2", "1", "0.5", "1 m/s, the worst of 10"),
        (
            "parameter: CURRENT_TRAVEL_SPEED, value: 1, tolerance: 0.1, at: 0.5, for: 2, once: %",
            "true",
            "false",
            "the worst of 10",
        ),
        (
            "parameter: CURRENT_TRAVEL_SPEED, value: %, tolerance: 0.1, for: 6, once: true",
            "1",
            "1.5",
            "the nearest of 30",
        ),
        ("parameter: ROTATE_SPEED, value: %, query: there", "1.5", "1", "rad/s"),
        ("telemetry: %, at: 1, for: 1", "5", "6", "5 ×"),
        ("pictures: 1, %: 64", "width", "height", "MOE-2.jpg is 64 × 48 px"),
        ("pictures: %", "1", "2", "1 stored"),
        ("file: pictures/MOE-2.jpg, events: [STORED%]", "", ", DELETED", "STORED"),
        ("file: other, events: [%]", "", "STORED", "no event"),
        ("files: [%], query: there", "pictures/MOE-2.jpg", "", "pictures/MOE-2.jpg"),
        ("fetched: %.jpg", "pictures/MOE-2", "none", "there is no file none.jpg"),
        ("video: %, for: 1", "0", "1", "0 pictures, 0 datagrams"),
        ("contacts: %", "0", "1", "0 contacts"),
        ("plan: tour, status: %", "SUBMITTED", "COMPLETED", "SUBMITTED, 0 of"),
        ("plan: %, status: SUBMITTED", "tour", "other", "no update"),
        ("plan: tour, status: SUBMITTED%", "", ", after: ahead STARTED", "no update"),
        ("link: ALARM%", ", count: 0", "", "0 ×"),
    ],
)
def test_holds_or_fails(
    played: tuple[Scenario, Record],
    tmp_path: Path,
    expectation: str,
    holding: str,
    failing: str,
    seen: str,
) -> None:
    """Both ways to fill in an expectation, where it has a %."""
    wanted = f"{{{expectation}}}"
    assert verdict(tmp_path, wanted.replace("%", holding), played[1]).passed
    finding = verdict(tmp_path, wanted.replace("%", failing), played[1])
    assert not finding.passed
    assert seen in finding.observed


@pytest.mark.parametrize(
    "never",
    [
        "{pose: {x: 1, y: 0}, tolerance: 9, after: turn EXECUTED}",
        "{rover: stationary, after: turn EXECUTED, for: 1}",
        "{mode: IDLE, after: turn EXECUTED}",
        "{telemetry: 0, after: turn EXECUTED, for: 1}",
        "{parameter: POS_X, value: 1, tolerance: 9, after: turn EXECUTED}",
        "{plan: tour, status: SUBMITTED, after: turn EXECUTED}",
    ],
)
def test_a_time_that_was_never_reached_fails(
    played: tuple[Scenario, Record], tmp_path: Path, never: str
) -> None:
    assert not verdict(tmp_path, never, played[1]).passed


def broken_promises(played: tuple[Scenario, Record], /, **changes: Any) -> list[str]:
    scenario, record = played
    findings = judge(scenario, replace(record, **changes))
    return [finding.expected for finding in findings if not finding.passed]


def test_a_command_that_ends_twice_breaks_a_promise(played: tuple[Scenario, Record]) -> None:
    reports = played[1].reports
    end = next(r for r in reports if r.identity == Identity("MOE", 1) and r.stage)
    again = replace(end, sequence=1000, stage=Stage.EXECUTED)
    broken = broken_promises(played, reports=[*reports, again])
    assert "every command received ends exactly once" in broken
    assert "reports are numbered without gaps" in broken


def test_an_entry_that_was_not_played_breaks_a_promise(played: tuple[Scenario, Record]) -> None:
    (broken,) = broken_promises(played, played=played[1].played - 1)
    assert "9 entries" in broken


def test_motion_while_stopped_breaks_a_promise(played: tuple[Scenario, Record]) -> None:
    modes = [ModeSample(step / 10, Mode.STOPPED) for step in range(100)]
    poses = [TruePose(step / 10, Pose(x_m=step / 1000)) for step in range(100)]
    broken = broken_promises(played, modes=modes, poses=poses)
    assert "no motion while STOPPED or SAFE" in broken


@pytest.mark.parametrize(
    ("octets", "fault"), [(b"\xff\xd8no picture", "does not decode"), (None, "is blank")]
)
def test_a_picture_must_have_content(
    played: tuple[Scenario, Record], tmp_path: Path, octets: bytes | None, fault: str
) -> None:
    path = tmp_path / "pictures/MOE-2.jpg"
    path.parent.mkdir()
    path.write_bytes(octets or jpeg_of_one_colour())
    finding = judge(played[0], replace(played[1], files=tmp_path))[0]
    assert not finding.passed
    assert fault in finding.observed


@pytest.mark.parametrize(
    ("change", "fault"),
    [({"received": b"pictura"}, "octets differ"), ({"checksum": 1}, "reported 00000001")],
)
def test_a_fetched_file_must_be_that_aboard(
    played: tuple[Scenario, Record], tmp_path: Path, change: dict[str, Any], fault: str
) -> None:
    record = played[1]
    spoilt = [
        replace(each, **change) if isinstance(each, Fetched) else each for each in record.fetched
    ]
    wanted = "{fetched: pictures/MOE-2.jpg}"
    finding = verdict(tmp_path, wanted, replace(record, fetched=spoilt))
    assert not finding.passed
    assert fault in finding.observed
    assert "never fetched" in verdict(tmp_path, wanted, replace(record, fetched=[])).observed


def test_video_must_have_content_and_end(played: tuple[Scenario, Record], tmp_path: Path) -> None:
    scene = (played[1].files / "pictures/MOE-2.jpg").read_bytes()
    blank = jpeg_of_one_colour()

    def finding(wanted: str, *pictures: bytes | None) -> Check:
        stream = [Datagram(1.5, picture) for picture in pictures]
        return verdict(tmp_path, wanted, replace(played[1], video=stream))

    assert finding("{video: 2, at: 1, for: 1}", None, scene, scene).passed
    assert not finding("{video: 2, at: 1, for: 1}", None, scene).passed
    assert not finding("{video: 2, at: 1, for: 0.4}", scene, scene).passed
    assert "is blank" in finding("{video: 1, at: 1, for: 1}", blank, scene).observed
    assert "does not decode" in finding("{video: 1, at: 1, for: 1}", b"no", scene).observed
    assert not finding("{video: 0, at: 1, for: 1}", None).passed
    assert finding("{video: 0, at: 2, for: 1}", None).passed


def jpeg_of_one_colour() -> bytes:
    octets = BytesIO()
    Image.new("RGB", (64, 48), "red").save(octets, "JPEG")
    return octets.getvalue()
