"""The examples of docs/obstacles.md can be read, and refuse what the page says."""

import re
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

from executive.commands import MoveForward, MoveTo, Waypoint
from executive.faults import FaultTable, Reaction
from executive.obstacles.zones import Footprint, Zones
from executive.settings import LaserSettings, Settings, parse_yaml, structure
from executive.values.reports import Stage
from tests.docs.pages import CHECKOUT, blocks
from tests.support.kinematic import Bench, ignoring
from tests.support.laser import Disc, ScanningRover

PAGE = CHECKOUT / "docs" / "obstacles.md"


def test_the_zones_are_several_and_refuse_and_are_detoured_as_documented(tmp_path: Path) -> None:
    (example,) = blocks(PAGE, "yaml")
    message = parse_yaml(example, PAGE.name)
    assert isinstance(message, dict)
    settings: Settings = replace(
        ignoring("odometry_off_twist"),
        footprint=structure(message["footprint"], Footprint, PAGE.name),
        zones=structure(message["zones"], Zones, PAGE.name),
    )
    with Bench(tmp_path, settings) as bench:
        assert f"    {bench.refusal(MoveForward(4.0), 1).text}\n" in PAGE.read_text()
        bench.execute(MoveTo(Waypoint(4.0, 0.0)), 2)
        around = next(each for each in bench.received.reports if each.stage is Stage.PROGRESS)
        assert f"    {around.text}\n" in PAGE.read_text()


def test_an_appearing_obstacle_is_detoured_as_documented(tmp_path: Path) -> None:
    asset = ignoring("odometry_off_twist")
    seeing = replace(asset, sensors=replace(asset.sensors, laser=LaserSettings(rate_hz=10)))
    rover = ScanningRover()
    with Bench(tmp_path, seeing, rover=rover) as bench:
        bench.submit(MoveTo(Waypoint(4.0, 0.0)), 1)
        bench.run(1.0)
        rover.discs.append(Disc(2.0, 0.2, 0.3))
        assert bench.finish(1) is Stage.EXECUTED
        around = next(each for each in bench.received.reports if each.stage is Stage.PROGRESS)
        assert f"    {around.text}\n" in PAGE.read_text(), around.text


def test_the_rows_of_faults_are_some() -> None:
    found = re.search(r"^    faults:\n(?:      .*\n)+", PAGE.read_text(), re.MULTILINE)
    assert found
    message = parse_yaml(dedent(found[0]), PAGE.name)
    assert isinstance(message, dict)
    table = structure(message["faults"], FaultTable, "the page")
    assert (table.obstacle_near.bound, table.obstacle_ahead.window.length_s) == (1.5, 0.3)
    assert table.laser_silent.reaction is Reaction.WARN
