"""A simulated rover is laden by a topic."""

from pathlib import Path

import pytest

from executive.settings import config_folder
from sim.scenario.live_cargo import loading
from tests.support.processes import simulation

pytestmark = pytest.mark.ros


def test_what_the_topic_says_is_aboard_if_it_is_a_mass(ros_domain: int, tmp_path: Path) -> None:
    parameters = config_folder() / "jackal.ros.yaml"
    with (
        simulation(tmp_path, "--camera", "off") as process,
        loading("jackal", ros_domain, parameters) as load,
    ):
        load(20.0)
        process.said(r"cargo aboard: 20 kg")
        load(-1.0)
        process.said(r"a cargo of -1 kg is not in 0 \.\. 50 kg")
        assert process.end() == 0
