"""A command that chooses mpc, over real processes; the simulation runs at half of real time.

Plans are late on a machine that has other things to do: what becomes of a motion then is shown in
lock step (`tests/core/test_predictive_control.py`).
"""

from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from executive.commands import MoveTo, Waypoint
from executive.settings import Controller, config_folder
from tests.support.ground import call_ground, until_located
from tests.support.probe import probing
from tests.support.processes import executive, simulation

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SIMULATED = ("--ros-args", "-p", "use_sim_time:=true")


async def submit(client: MrsClient) -> None:
    await client.submit(client.command(MoveTo(Waypoint(1.2, 0.8), Controller.MPC)))


@pytest.mark.usefixtures("ros_domain")
def test_it_drives_a_curve(tmp_path: Path) -> None:
    text = (config_folder() / "jackal.yaml").read_text(encoding="utf-8")
    asset = tmp_path / "jackal.yaml"
    asset.write_text(text.replace("selectable: false", "selectable: true"), encoding="utf-8")
    with (
        simulation(tmp_path, "--speed", "0.5", "--camera", "off"),
        probing() as probe,
        executive(tmp_path, "--asset", str(asset), *SIMULATED) as (process, uri),
    ):
        until_located(uri)
        call_ground(uri, submit)
        probe.until(
            lambda: any(
                min(abs(v.twist.linear.x), abs(v.twist.angular.z)) > 0.2 for v in probe.velocities
            ),
            "a curve",
        )
        process.output("moveTo predicted: ")
        process.output("EXECUTED moveTo")
