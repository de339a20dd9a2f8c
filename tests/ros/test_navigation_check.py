"""`rover doctor` on a navigation: unknown parameters, absent servers, a wrong type of velocity."""

from pathlib import Path

import pytest
from geometry_msgs.msg import Twist

from adapters.ros import ros_node
from adapters.ros.check import check_navigation
from executive.settings import config_folder, load_settings
from tests.support.navigated_rover import navigated
from tests.support.patience import shipped_config


@pytest.mark.ros
@pytest.mark.usefixtures("ros_domain")
def test_errors_of_a_navigation_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = shipped_config(tmp_path, config_folder())
    navigated(config)
    parameters = config / "jackal.ros.yaml"
    typos = "{to_pse: {action: to}, velocity: {topc: v}}"
    parameters.write_text(f"{parameters.read_text()}\n    navigation: {typos}\n")
    monkeypatch.setenv("ROVER_CONFIG", str(config))
    with ros_node("planner", "jackal") as node:
        node.create_publisher(Twist, "nav_vel", 1)
        found = list(check_navigation("jackal", load_settings("jackal"), None, 0.5))
    errors = "\n".join(text for prevents, text, _ in found if prevents)
    assert "navigation.to_pse.action of " in errors
    assert "unknown: to_pose, through_poses, compute_path, velocity" in errors
    assert "navigation.velocity.topc of " in errors
    assert "no mux subscribes to /jackal/navigation_lock" in errors
    assert "planner publishes geometry_msgs/msg/Twist on /jackal/nav_vel: the mux rec" in errors
    warnings = [text for prevents, text, _ in found if not prevents]
    assert "there is no action server /jackal/navigate_to_pose" in warnings
    assert not any("no node publishes" in each for each in warnings)
