"""Which class speaks with a rover is said by the asset's YAML; what cannot be is told at once."""

import ast
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from adapters.onboard.process import main
from adapters.onboard.service import rover_kind
from adapters.ros import RosRover
from executive.settings import Settings, SettingsError, load_settings
from tests.support.processes import running

JACKAL = load_settings("jackal")
MOCUP = load_settings("mocup")


def test_a_rover_on_cmd_vel_needs_no_name() -> None:
    assert rover_kind(JACKAL) is RosRover
    assert rover_kind(replace(JACKAL, rover="adapters.ros.rover:RosRover")) is RosRover


def test_mocup_is_named_by_its_settings() -> None:
    assert rover_kind(MOCUP).__qualname__ == "MocupOnRos"


@pytest.mark.parametrize(
    ("asset", "rover", "told"),
    [
        (MOCUP, None, "needs the key rover: module:Class"),
        *((MOCUP, name, "module:Class, such as") for name in ("mocup", "mocup:", ":Mocup", "")),
        (JACKAL, "scuot.rover:Scout", "No module named 'scuot'.*PYTHONPATH"),
        (MOCUP, "adapters.onboard.mocup:Mocup", "has no class 'Mocup'; there are: MocupOnRos$"),
        (JACKAL, "adapters.ros.rover:STANDING", "has no class 'STANDING'; there are: RosRover$"),
        (JACKAL, MOCUP.rover, "lacks drive: with locomotion velocity"),
        (MOCUP, "adapters.ros.rover:RosRover", "lacks carry_out, halt: with .* whole_motion"),
    ],
)
def test_what_names_no_fitting_class_is_told_why(
    asset: Settings, rover: str | None, told: str
) -> None:
    with pytest.raises(SettingsError, match=re.compile(told, re.DOTALL)):
        rover_kind(replace(asset, rover=rover))


@pytest.mark.ros
def test_the_process_does_not_start_without_its_rover(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain
    settings = tmp_path / "crab.yaml"
    text = (Path(__file__).parents[2] / "config" / "jackal.yaml").read_text()
    settings.write_text(text + "rover: crab:Crab\n")
    options = ("--asset", str(settings), "--data", str(tmp_path / "data"), "--port", "0")
    with running(tmp_path / "log", "rover-executive", *options) as process:
        assert process.ended() == 2
        assert "rover crab:Crab: No module named 'crab'" in process.text
        assert "Traceback" not in process.text


LAUNCH_FILE = Path(__file__).parents[2] / "launch" / "rover.launch.py"


def test_arguments_are_options_of_the_process_with_its_defaults() -> None:
    module = ast.parse(LAUNCH_FILE.read_text())
    (options,) = (
        ast.literal_eval(node.value)
        for node in module.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "OPTIONS"
    )
    words = [word for name, (text, _) in options.items() if text for word in (f"--{name}", text)]
    files = ("certificate", "key", "authorities")
    assert {name for name, (text, _) in options.items() if not text} == set(files)
    assert parsed(words) == parsed([])
    taken = parsed([word for name in files for word in (f"--{name}", "a.pem")])
    assert [str(taken[name]) for name in files] == ["a.pem"] * 3


def parsed(words: list[str]) -> dict[str, Any]:
    params: dict[str, Any] = main.make_context("rover-executive", words).params
    return params
