"""Viewers are shown what happened, in the schemas that they know, and the layout fits it."""

import base64
import io
import json
from collections.abc import Iterator
from dataclasses import replace
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from adapters.recording import RunFile
from adapters.recording.view import TOPICS, ViewBuilder, ViewMessage
from executive.commands import Command, FollowPath, Mode, MoveTo, Request, Waypoint
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    FactObserved,
    Item,
    ModeChanged,
    PathRequested,
    ProcessStart,
    ReportSent,
    TreeChanged,
    TreeNodeState,
    VelocityCommanded,
)
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock, Zones
from executive.settings import config_folder, load_settings
from executive.values.facts import (
    Fact,
    Frame,
    LaserScan,
    MapToOdom,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    Odometry,
    PlannedPath,
    SecondOdometry,
)
from executive.values.geometry import Point, Pose, TargetFrame, Velocity
from executive.values.ports import PathRequest
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

YARD = ((-1.0, -2.0), (5.0, -2.0), (5.0, 2.0), (-1.0, 2.0))
ZONES = Zones((KeepIn("yard", YARD),), (KeepOut("bed", YARD),), (KnownRock("boulder", 3, 1, 0.5),))
SETTINGS = replace(load_settings("jackal"), zones=ZONES)
IDENTITY = Identity("MOE", 1)
PYTHON: Any = {"string": str, "integer": int, "boolean": bool, "number": (int, float)}
LAYOUT = config_folder() / "rover.foxglove.json"


def start() -> ProcessStart:
    return ProcessStart(SETTINGS, b"", b"", (), None, video=False)


def tick(at_s: float) -> CoreCalled:
    return CoreCalled(at_s, at_s, CoreCall.TICK)


def observed(at_s: float, fact: Fact) -> FactObserved:
    return FactObserved(at_s, at_s, fact)


def odometry(at_s: float, x_m: float = 0.0) -> FactObserved:
    return observed(at_s, Odometry(at_s, Pose(x_m), Velocity()))


def reported(stage: Stage) -> ReportSent:
    return ReportSent(
        Report(1, 0.0, ReportKind.COMMAND, Severity.INFORMATIONAL, "so", IDENTITY, stage, "direct")
    )


def shown(*items: Item) -> list[ViewMessage]:
    view = ViewBuilder()
    made = [each for item in items for each in view.of(item)]
    for each in made:
        check(each.topic, each.message)
    return made


def check(topic: str, message: dict[str, Any]) -> None:
    """Check that a message is as its schema says; those of Foxglove's schemas lack nothing."""
    schema = TOPICS[topic]
    whole = schema.name.startswith("foxglove.")
    assert not misfits(message, schema.json, whole), topic


def on(topic: str, messages: list[ViewMessage]) -> list[dict[str, Any]]:
    return [each.message for each in messages if each.topic == topic]


def misfits(value: Any, schema: dict[str, Any], whole: bool) -> list[str]:
    """Return what of a value is not as its schema says."""
    match schema["type"]:
        case "object":
            known = schema["properties"]
            found = [f"unknown {key}" for key in value.keys() - known.keys()]
            found += [f"no {key}" for key in known.keys() - value.keys() if whole]
            both = known.keys() & value.keys()
            return found + [each for key in both for each in misfits(value[key], known[key], whole)]
        case "array":
            return [each for part in value for each in misfits(part, schema["items"], whole)]
        case kind:
            return [] if isinstance(value, PYTHON[kind]) else [f"{value!r} is no {kind}"]


def test_a_recording_shows_its_run(stuck: Path) -> None:
    seen: dict[str, list[dict[str, Any]]] = {}
    last_ns = 0
    with stuck.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert message.log_time >= last_ns
            last_ns = message.log_time
            if channel.topic == "/run":
                continue
            assert schema is not None
            assert (schema.name, schema.encoding) == (TOPICS[channel.topic].name, "jsonschema")
            reported = json.loads(message.data, parse_constant=pytest.fail)
            assert json.loads(schema.data) == TOPICS[channel.topic].json
            check(channel.topic, reported)
            seen.setdefault(channel.topic, []).append(reported)
    failed = [each for each in seen["/log"] if each["message"].startswith("FAILED")]
    assert [(each["name"], each["level"]) for each in failed] == [("MOE:1", 4)]
    assert failed[0]["message"].startswith("FAILED, the left wheels do not follow")
    transform = seen["/tf"][-1]
    assert (transform["parent_frame_id"], transform["child_frame_id"]) == ("odom", "base_link")
    assert transform["translation"]["x"] > 0.2
    motion = max(seen["/motion"], key=lambda each: each.get("commanded", {}).get("travel_mps", 0))
    assert motion["commanded"]["travel_mps"] == pytest.approx(1.0, abs=0.1)
    assert {"odometry", "imu", "wheels", "battery", "camera"} <= motion.keys()
    ticked = {each["path"] for message in seen["/tree"] for each in message["nodes"]}
    assert {"rover", "rover/idle"} <= ticked
    assert {"/scene/rover", "/scene/track", "/scene/goal", "/pose/truth", "/mode"} <= seen.keys()


def test_a_navigation_has_a_topic_and_the_path_of_its_planner_is_the_goal() -> None:
    request = PathRequest(1, Pose(), Pose(2.0), TargetFrame.MAP)
    messages = shown(
        FactObserved(0.0, 0.0, MapToOdom(Pose(1.0, 0.0))),
        PathRequested(request),
        FactObserved(0.1, 0.1, PlannedPath(-1, (Point(7.0, 7.0), Point(8.0, 8.0)))),
        FactObserved(0.1, 0.1, PlannedPath(1, (Point(1.0, 0.0), Point(2.0, 1.0)))),
        FactObserved(0.2, 0.2, NavigationFeedback(3, 2.5, 1)),
        FactObserved(0.3, 0.3, NavigationFeedback(3, 2.4, 1)),
        FactObserved(
            0.4, 0.4, NavigationStatus(3, NavigationState.ABORTED, 105, "FAILED", "no progress")
        ),
    )
    (goal,) = on("/scene/goal", messages)
    points = goal["entities"][0]["lines"][0]["points"]
    assert [(each["x"], each["y"]) for each in points] == [(0.0, 0.0), (1.0, 1.0)]
    first, last = on("/navigation", messages)
    assert (first["goal"], first["remaining_m"], first["recoveries"]) == (3, 2.5, 1)
    assert (last["state"], last["text"]) == ("aborted", "FAILED 105, no progress")
    assert last["remaining_m"] == 2.4


def test_frequent_topics_are_thinned() -> None:
    moved = [item for n in range(100) for item in (odometry(n * 0.02), tick(n * 0.02))]
    messages = shown(start(), *moved)
    assert len(on("/tf", messages)) == len(on("/motion", messages)) == 20


def test_the_positions_of_a_track_are_few_for_any_length() -> None:
    messages = shown(start(), *(odometry(float(n), n * 0.25) for n in range(4000)))
    (track,) = on("/scene/track", messages)[-1]["entities"]
    positions = track["lines"][0]["points"]
    assert 50 < len(positions) <= 200
    assert (positions[0]["x"], positions[-1]["x"]) == (0.0, pytest.approx(999.0, abs=20))


@pytest.mark.parametrize(
    ("request_", "end"),
    [
        (MoveTo(Waypoint(2.0, 1.0)), (2.0, 1.0)),
        (FollowPath((Waypoint(1.0, 0.0), Waypoint(3.0, 4.0))), (3.0, 4.0)),
    ],
)
def test_a_goal_is_drawn_while_it_is_driven_to(request_: Request, end: tuple[float, float]) -> None:
    messages = shown(
        start(),
        odometry(1.0, 0.5),
        CommandDequeued(Command(IDENTITY, request_, "direct"), overtaken=False),
        reported(Stage.STARTED),
        reported(Stage.EXECUTED),
    )
    drawn, closed = on("/scene/goal", messages)
    points = drawn["entities"][0]["lines"][0]["points"]
    assert points[0]["x"] == 0.5
    assert (points[-1]["x"], points[-1]["y"]) == end
    assert (closed["entities"], len(closed["deletions"])) == ([], 1)


def test_zones_and_rocks_are_shown_once_a_file() -> None:
    view = ViewBuilder()
    items = (start(), tick(1.0), tick(2.0))
    (zones,) = on("/scene/zones", [each for item in items for each in view.of(item)])
    assert [each["id"] for each in zones["entities"]] == [each.label for each in ZONES]
    rock = zones["entities"][-1]["cylinders"][0]
    assert (rock["pose"]["position"]["x"], rock["size"]["y"]) == (3.0, 1.0)
    mode = ModeChanged(Mode.IDLE, None, "nothing is commanded")
    (reported,) = view.of(mode)
    view.restart_file()
    again = list(view.of(tick(3.0)))
    assert on("/scene/zones", again) == [
        json.loads(json.dumps(zones).replace('"sec": 1,', '"sec": 3,'))
    ]
    assert on("/mode", again) == [reported.message]


def test_a_scan_and_a_second_odometry_are_shown() -> None:
    messages = shown(
        start(),
        observed(1.0, LaserScan(1.0, -1.0, 1.0, 0.1, 10.0, (1.234, inf, 2.0))),
        observed(1.0, SecondOdometry(1.0, Pose(2.0))),
    )
    (scan,) = on("/scan", messages)
    assert (scan["start_angle"], scan["end_angle"]) == (-1.0, 1.0)
    assert scan["ranges"] == [1.23, 0.0, 2.0]
    (pose,) = on("/pose/second_odometry", messages)
    assert pose["pose"]["position"]["x"] == 2.0


def test_an_invalid_number_is_not_shown() -> None:
    facts = (Odometry(1.0, Pose(nan), Velocity()), SecondOdometry(1.0, Pose(inf)))
    assert shown(start(), *(observed(1.0, fact) for fact in facts)) == []


def test_a_picture_is_shown_small() -> None:
    image = pytest.importorskip("PIL.Image")
    out = io.BytesIO()
    image.new("RGB", (640, 480), "red").save(out, "JPEG")
    pictures = (Frame(1.0, "JPG", out.getvalue()), Frame(1.0, "JPG", b"\xff\xd8\xff, and no more"))
    (reported,) = on("/camera", shown(start(), *(observed(1.0, each) for each in pictures)))
    with image.open(io.BytesIO(base64.b64decode(reported["data"]))) as small:
        assert (small.format, small.size) == ("JPEG", (160, 120))


def test_nodes_that_went_are_no_longer_shown() -> None:
    nodes = (TreeNodeState("a", "RUNNING", "on its way"), TreeNodeState("b", "IDLE", ""))
    messages = shown(
        start(), TreeChanged(nodes, ()), tick(1.0), tick(1.5), TreeChanged((), ("a",)), tick(3.0)
    )
    assert on("/tree", messages) == [
        {"nodes": [{"path": "a", "status": "RUNNING", "message": "on its way"}]},
        {"nodes": []},
    ]


def test_what_cannot_be_shown_harms_no_recording(tmp_path: Path) -> None:
    file = RunFile(tmp_path / "run.mcap")
    for item in (start(), tick(1.0), VelocityCommanded(Velocity(nan, 0.0)), tick(2.0)):
        file.put(item)
    file.close()
    with (tmp_path / "run.mcap").open("rb") as written:
        topics = [channel.topic for _, channel, _ in make_reader(written).iter_messages()]
    assert "/run" in topics
    assert "/motion" not in topics


def test_the_layout_shows_topics_of_the_view() -> None:
    layout = json.loads(LAYOUT.read_text(encoding="utf-8"))
    panels = layout["configById"]
    assert set(_placed(layout["layout"], panels)) == panels.keys()
    shown_topics = {
        *(topic for panel in panels.values() for topic in panel.get("topics", ())),
        *(panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel),
        *(panel["imageMode"]["imageTopic"] for key, panel in panels.items() if "Image!" in key),
    }
    paths = [each["value"] for panel in panels.values() for each in panel.get("paths", ())]
    paths += [panel["topicPath"] for panel in panels.values() if "topicPath" in panel]
    for path in paths:
        topic, *names = path.split(".")
        shown_topics.add(topic)
        schema = TOPICS[topic].json
        for name in names:
            schema = schema["properties"][name]
    assert shown_topics | {"/tf", "/parameters", "/navigation"} == TOPICS.keys()


def _placed(part: Any, panels: dict[str, Any]) -> Iterator[str]:
    """Yield the panels in a part of a layout."""
    if isinstance(part, dict):
        yield from _placed(part["first"], panels)
        yield from _placed(part["second"], panels)
        return
    yield part
    for tab in panels[part].get("tabs", ()):
        yield from _placed(tab["layout"], panels)
