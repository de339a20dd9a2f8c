"""Which class speaks with a rover is said by the asset's YAML; what cannot be is told at once."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.onboard.service import rover_kind
from adapters.ros import RosRover
from executive.settings import LocomotionKind, Settings, SettingsError, load_settings
from tests.support.processes import LIMIT_S

JACKAL = load_settings("jackal")
MOCUP = load_settings("mocup")


def refusal(settings: Settings) -> str:
    with pytest.raises(SettingsError) as raised:
        rover_kind(settings)
    return str(raised.value)


def test_a_rover_on_cmd_vel_needs_no_name() -> None:
    assert rover_kind(JACKAL) is RosRover
    assert rover_kind(replace(JACKAL, rover="adapters.ros.rover:RosRover")) is RosRover


def test_mocup_is_named_by_its_settings() -> None:
    assert rover_kind(MOCUP).__qualname__ == "MocupOnRos"


def test_who_moves_by_itself_has_to_be_named() -> None:
    assert "needs the key rover: module:Class" in refusal(replace(MOCUP, rover=None))


@pytest.mark.parametrize("name", ["mocup", "mocup:", ":Mocup", ""])
def test_a_name_of_another_form_is_refused(name: str) -> None:
    assert "module:Class, such as" in refusal(replace(MOCUP, rover=name))


def test_a_module_that_is_not_there_is_named() -> None:
    text = refusal(replace(JACKAL, rover="scuot.rover:Scout"))
    assert "No module named 'scuot'" in text
    assert "PYTHONPATH" in text


def test_a_class_that_is_not_there_is_answered_by_those_that_are() -> None:
    text = refusal(replace(MOCUP, rover="adapters.onboard.mocup:Mocup"))
    assert text.endswith("has no class 'Mocup'; there are: MocupOnRos")


def test_a_name_of_no_class_is_answered_by_those_that_are() -> None:
    text = refusal(replace(JACKAL, rover="adapters.ros.rover:STANDING"))
    assert text.endswith("has no class 'STANDING'; there are: RosRover")


def test_a_class_of_the_other_way_is_told_what_it_lacks() -> None:
    taken = replace(JACKAL, rover=MOCUP.rover)
    assert "lacks drive: with locomotion velocity" in refusal(taken)
    carries_out = replace(MOCUP, rover="adapters.ros.rover:RosRover")
    assert "lacks carry_out, halt: with locomotion whole_motion" in refusal(carries_out)
    assert carries_out.locomotion is LocomotionKind.WHOLE_MOTION


@pytest.mark.ros
def test_the_process_does_not_start_without_its_rover(ros_domain: int, tmp_path: Path) -> None:
    assert ros_domain
    settings = tmp_path / "crab.yaml"
    text = (Path(__file__).parents[2] / "config" / "jackal.yaml").read_text()
    settings.write_text(text + "rover: crab:Crab\n")
    ended = subprocess.run(
        [
            str(Path(sys.executable).with_name("rover-executive")),
            *("--asset", str(settings), "--data", str(tmp_path / "data"), "--port", "0"),
        ],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )
    assert ended.returncode == 2
    assert "rover crab:Crab: No module named 'crab'" in ended.stderr
    assert "Traceback" not in ended.stderr
