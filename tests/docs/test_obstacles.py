"""The example of docs/obstacles.md can be read, and refuses what the page says."""

from dataclasses import replace
from pathlib import Path

from executive.commands import MoveForward
from executive.settings import Settings, load_settings, parse_yaml, structure
from executive.zones import Footprint, Zones
from tests.docs.pages import CHECKOUT, blocks
from tests.support.kinematic import Bench

PAGE = CHECKOUT / "docs" / "obstacles.md"


def test_the_zones_are_some_and_refuse_as_told(tmp_path: Path) -> None:
    (example,) = blocks(PAGE, "yaml")
    said = parse_yaml(example, PAGE.name)
    assert isinstance(said, dict)
    settings: Settings = replace(
        load_settings("jackal"),
        footprint=structure(said["footprint"], Footprint, PAGE.name),
        zones=structure(said["zones"], Zones, PAGE.name),
    )
    with Bench(tmp_path, settings) as bench:
        assert f"    {bench.refusal(MoveForward(4.0), 1).text}\n" in PAGE.read_text()
