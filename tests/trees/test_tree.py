import sys
import xml.etree.ElementTree as ET
from importlib import reload
from io import StringIO
from pathlib import Path

import pytest
from click.testing import CliRunner
from py_trees.common import Status
from rich.console import Console

from executive.commands import CameraWork, Motion, MoveTo, Request, Stop, TakePicture, Waypoint
from executive.settings import load_settings
from executive.values.reports import Stage
from tests.support.kinematic import Bench
from tests.support.requests import GOOD
from trees import (
    DisplayStatus,
    NodeKind,
    NodeStatus,
    RoverTree,
    TreeNodeSnapshot,
    TreeSnapshot,
    as_svg,
    bare_py_trees,
    commands_by_node,
    display_statuses,
)
from trees.cli import tree
from trees.motion import Turn
from trees.rover import preview
from trees.screen import render
from trees.snapshot import as_mermaid, as_text, nodes


def snapshot(bench: Bench) -> dict[str, TreeNodeSnapshot]:
    assert isinstance(bench.executive.tree, RoverTree)
    tree = bench.executive.tree
    return {node.path: node for node in nodes(tree.root, tree.ticked)}


def running(bench: Bench) -> set[str]:
    return {node.name for node in snapshot(bench).values() if node.status is NodeStatus.RUNNING}


def test_priority_stop_is_over_safety_over_work_over_idle() -> None:
    below_root = [node.name for node in preview(load_settings("jackal")) if node.depth == 1]
    assert below_root == ["priority stop", "safety", "work", "idle"]


def test_paths_are_unique_and_the_same_in_every_build(bench: Bench) -> None:
    paths = [node.path for node in preview(load_settings("jackal"))]
    assert len(set(paths)) == len(paths)
    assert paths == list(snapshot(bench))


def test_active_nodes_are_shown_with_their_messages(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 2)
    bench.run(0.5)
    assert {"rover", "work", "motion", "leg", "drive", "camera", "capture"} <= running(bench)
    drive = snapshot(bench)["rover/work/side by side/motion/go/leg/drive"]
    assert "m remaining" in drive.message


def test_an_unticked_node_is_idle_though_it_ran_the_tick_before(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.run(0.5)
    before = snapshot(bench)["rover/work/side by side/camera/no camera work"]
    assert before.status is NodeStatus.SUCCESS
    bench.rover.camera_works = False
    bench.submit(TakePicture(), 2)
    camera = snapshot(bench)
    assert camera["rover/work/side by side/camera/picture/capture"].status is NodeStatus.RUNNING
    assert camera["rover/work/side by side/camera/no camera work"].status is NodeStatus.IDLE


def test_a_branch_names_the_command_that_it_works_on_until_the_next(bench: Bench) -> None:
    def working() -> dict[str, str]:
        found = tuple(snapshot(bench).values())
        pairs = zip(found, commands_by_node(found), strict=True)
        return {node.name: command for node, command in pairs if command is not None}

    assert working() == {}
    bench.submit(MoveTo(Waypoint(0.5, 0.0)), 1)
    bench.submit(TakePicture(), 2)
    bench.run(5.0)
    after = working()
    assert (after["go"], after["drive"], after["take place"]) == ("MOE:1",) * 3
    assert (after["picture"], after["capture"]) == ("MOE:2",) * 2
    assert not after.keys() & {"rover", "work", "side by side", "motion", "velocity", "stop"}
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 3)
    bench.run(0.5)
    assert (working()["drive"], working()["capture"]) == ("MOE:3", "MOE:2")
    bench.submit(Stop(), 4)
    assert (working()["stop"], working()["drive"]) == ("MOE:4", "MOE:3")


def test_a_stop_wins_over_work_at_once(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 0.0)), 1)
    bench.run(1.0)
    bench.submit(Stop(), 2)
    assert running(bench) == {"rover", "priority stop", "stop"}


@pytest.mark.parametrize(
    "request_",
    [request for request in GOOD if isinstance(request, Motion | CameraWork)],
    ids=lambda request: type(request).__name__,
)
def test_every_motion_and_camera_goal_has_a_leaf(bench: Bench, request_: Request) -> None:
    bench.rover.camera_works, bench.rover.lazy_camera = False, True
    bench.submit(request_, 1)
    bench.run(0.2)
    found = tuple(snapshot(bench).values())
    leaves = {
        command
        for node, command in zip(found, commands_by_node(found), strict=True)
        if node.kind is NodeKind.LEAF and node.status is NodeStatus.RUNNING
    }
    assert leaves == {"MOE:1"}, "no leaf works on the goal"
    assert bench.stages(1)[-1] is Stage.STARTED


def test_every_leaf_has_a_deadline_before_it_acts(bench: Bench) -> None:
    bench.submit(MoveTo(Waypoint(2.0, 1.0, 0.0)), 1)
    assert isinstance(bench.executive.tree, RoverTree)
    bench.run(0.5)
    (running,) = [
        node
        for node in bench.executive.tree.root.iterate()
        if isinstance(node, Turn) and node.status is Status.RUNNING
    ]
    assert bench.clock.now_s() < running.deadline_s < bench.clock.now_s() + 20.0


def test_text_has_a_line_for_each_node_under_its_parent(bench: Bench) -> None:
    found = tuple(snapshot(bench).values())
    lines = as_text(found).splitlines()
    assert len(lines) == len(found)
    for line, node in zip(lines, found, strict=True):
        assert node.name in line
        assert len(line) - len(line.lstrip("│├└─ ")) == 3 * node.depth


def test_mermaid_and_svg_have_every_node_and_edge(bench: Bench) -> None:
    found = tuple(snapshot(bench).values())
    drawn = as_mermaid(found)
    assert drawn.count(" --> ") == len(found) - 1
    svg = ET.fromstring(as_svg(found, title="a < b"))
    texts = [element.text or "" for element in svg.iter("{http://www.w3.org/2000/svg}text")]
    assert texts[0] == "a < b"
    for node, text in zip(found, texts[1:], strict=False):  # the legend follows
        assert node.name in text


def _node(path: str, kind: NodeKind, status: NodeStatus) -> TreeNodeSnapshot:
    return TreeNodeSnapshot(path, path.rpartition("/")[2], path.count("/"), kind, status, "")


def test_a_guard_that_finds_nothing_is_no_failure_but_an_aborted_leaf_is() -> None:
    fails = NodeStatus.FAILURE
    seen = display_statuses(
        [
            _node("a", NodeKind.SELECTOR, fails),
            _node("a/stop", NodeKind.SEQUENCE, fails),
            _node("a/stop/stopping?", NodeKind.CONDITION, fails),
            _node("a/stop/act", NodeKind.LEAF, NodeStatus.IDLE),
            _node("a/go", NodeKind.SEQUENCE, fails),
            _node("a/go/take", NodeKind.TAKE, NodeStatus.SUCCESS),
            _node("a/go/drive", NodeKind.LEAF, fails),
        ]
    )
    wrong, nothing = DisplayStatus.FAILURE, DisplayStatus.DECLINED
    assert seen == (
        wrong,
        nothing,
        nothing,
        DisplayStatus.IDLE,
        wrong,
        DisplayStatus.SUCCESS,
        wrong,
    )


@pytest.mark.parametrize(
    ("form", "beginning"), [("unicode", "? rover"), ("mermaid", "flowchart"), ("svg", "<svg")]
)
def test_rover_tree_draws_in_three_forms(form: str, beginning: str) -> None:
    result = CliRunner().invoke(tree, ["--format", form])
    assert result.exit_code == 0
    assert result.output.startswith(beginning)


def test_rover_tree_reports_an_invalid_asset_file(tmp_path: Path) -> None:
    bad = tmp_path / "mine.yaml"
    bad.write_text("asset: mine\nspeed: 3\n")
    result = CliRunner().invoke(tree, ["--asset", str(bad)])
    assert result.exit_code == 2
    assert "speed" in result.output
    assert "mine.yaml" in result.output


def test_a_small_terminal_shows_no_failure_of_an_idle_rover(bench: Bench) -> None:
    found = tuple(snapshot(bench).values())
    console = Console(record=True, file=StringIO(), width=100)
    console.print(render("jackal", TreeSnapshot(1, 0.0, "IDLE", "no goal", found), height=20))
    shown = console.export_text()
    assert "priority stop –" in shown
    assert "stopping?" not in shown, "it is collapsed"
    assert "✕" not in shown


def test_other_programs_of_the_process_have_all_of_py_trees(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delitem(sys.modules, "py_trees")
    reload(bare_py_trees)
    bare = sys.modules["py_trees"]
    assert "display" not in vars(bare)
    for name in ("behaviour", "display", "trees", "version", "visitors"):
        assert getattr(bare, name) is sys.modules[f"py_trees.{name}"]
    for name in ("absent", "__version__"):
        assert not hasattr(bare, name)
