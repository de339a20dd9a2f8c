"""docs/above-nav2.md and docs/command-from-ros.md, followed with substitutes of Nav2 and `ros2`."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from executive.settings import config_folder, load_settings, load_yaml, parse_yaml
from tests.docs.pages import CHECKOUT, blocks
from tests.support.patience import shipped_config

ABOVE_NAV2 = CHECKOUT / "docs" / "above-nav2.md"
FROM_ROS = CHECKOUT / "docs" / "command-from-ros.md"


def sections(page: Path, key: str) -> dict[str, Any]:
    """Return the YAML block of a page whose first key is this."""
    found = [parse_yaml(block, page.name) for block in blocks(page, "yaml")]
    (only,) = (each for each in found if isinstance(each, dict) and next(iter(each)) == key)
    return only


def asset_of_the_pages(folder: Path) -> Path:
    """Replace and add the sections that the pages show; return the configuration."""
    config = shipped_config(folder, config_folder())
    path = config / "jackal.yaml"
    raw: Any = load_yaml(path)
    raw |= sections(ABOVE_NAV2, "controller") | sections(FROM_ROS, "ros")
    path.write_text(yaml.safe_dump(raw, sort_keys=False))
    return config


def test_the_mux_of_the_page_is_that_of_the_asset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twist_mux = sections(ABOVE_NAV2, "twist_mux")["twist_mux"]["ros__parameters"]
    mux = sections(ABOVE_NAV2, "controller")["mux"]
    assert (twist_mux["topics"], twist_mux["locks"]) == (mux["topics"], mux["locks"])
    nav2 = sections(ABOVE_NAV2, "collision_monitor")["collision_monitor"]["ros__parameters"]
    assert nav2["cmd_vel_out_topic"] == mux["topics"]["navigation"]["topic"]
    monkeypatch.setenv("ROVER_CONFIG", str(asset_of_the_pages(tmp_path)))
    assert load_settings("jackal").offers_navigation


def test_the_tool_of_rviz_is_on_the_topic_of_the_page() -> None:
    shown = yaml.safe_load((config_folder() / "rover.rviz").read_text())
    (goal,) = (each["Topic"] for each in shown["Visualization Manager"]["Tools"] if "Topic" in each)
    assert f"set *Topic* to `{goal['Value']}`" in " ".join(FROM_ROS.read_text().split())
