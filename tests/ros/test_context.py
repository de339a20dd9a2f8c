"""Which transports a node of ours uses, where the user chose some or none."""

import os

import pytest

from adapters.ros.context import ros_node
from executive.settings import config_folder

pytestmark = [pytest.mark.ros, pytest.mark.usefixtures("ros_domain")]

PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"


@pytest.fixture(autouse=True)
def no_choice(monkeypatch: pytest.MonkeyPatch, ros_domain: int) -> None:
    """Take away what the user, or the fixture before this one, chose."""
    assert ros_domain > 0
    for name in (PROFILE, "FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISCOVERY_SERVER", "ROS_DISTRO"):
        monkeypatch.delenv(name, raising=False)


def test_without_a_choice_a_node_stays_on_loopback() -> None:
    with ros_node("node", "jackal"):
        assert os.environ[PROFILE] == str(config_folder() / "fastdds.xml")


@pytest.mark.parametrize("choice", ["FASTDDS_BUILTIN_TRANSPORTS", "ROS_DISTRO"])
def test_a_choice_is_respected(choice: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(choice, "UDPv4")
    with ros_node("node", "jackal"):
        assert PROFILE not in os.environ
