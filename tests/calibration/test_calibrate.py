"""`rover calibrate`: figures are found again in a simulated drive, and written into the YAML."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from adapters.calibration import Calibration, calibrate, plan_xml, read_drive
from executive.commands import PlanDefinition
from executive.plans import check_plan
from executive.settings import MpcSettings, load_settings
from executive.values.reasons import Refusal
from sim.calibration.commands import calibrate as command
from sim.calibration.drive import drive_pattern

JACKAL = load_settings("jackal")
UNKNOWN = replace(JACKAL, mpc=MpcSettings(odometry_age_s=JACKAL.mpc.odometry_age_s))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a recording of a drive with settings that know nothing of the rover."""
    path = tmp_path_factory.mktemp("calibration") / "run.mcap"
    drive_pattern(UNKNOWN, path, cargo_kg=0.0, seed=3)
    return path


@pytest.fixture(scope="module")
def found(recording: Path) -> Calibration:
    return calibrate(read_drive(recording))


def test_what_was_fitted_by_hand_is_found_again(found: Calibration) -> None:
    figures, jackal = found.settings, JACKAL.mpc
    turn_drive = JACKAL.turn_drive
    assert figures["turn_drive.latency_s"] == pytest.approx(turn_drive.latency_s, abs=0.015)
    assert figures["turn_drive.control_point_m"] == pytest.approx(
        turn_drive.control_point_m, abs=0.005
    )
    assert figures["mpc.command_delay_s"] == pytest.approx(jackal.command_delay_s, abs=0.005)
    assert jackal.odometry_slip is not None
    for name, law in (("slip", jackal.slip), ("odometry_slip", jackal.odometry_slip)):
        assert figures[f"mpc.{name}.offset_m"] == pytest.approx(law.offset_m, abs=0.005)
        assert figures[f"mpc.{name}.gain_m"] == pytest.approx(law.gain_m, abs=0.015)
    assert found.travel_scale == pytest.approx(1.0, abs=0.01)


def test_the_track_is_that_of_skid_steering(found: Calibration) -> None:
    ratio = found.settings["sensors.joints.track_m"] / 0.37559
    assert ratio == pytest.approx(1.44, abs=0.03), "Coulomb friction of four equal wheels says so"


def test_less_is_left_over_than_before(found: Calibration) -> None:
    left = {each.name: each.after / each.before for each in found.residuals}
    assert left["rate of turn"] < 0.35
    assert left["slip"] < 0.25
    assert left["odometry's own slip model"] < 0.05


def test_the_command_writes_what_it_found(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "jackal.yaml"
    result = CliRunner().invoke(command, [str(recording), "--out", str(out), "--json"])
    assert result.exit_code == 0, result.output
    told = {each["key"]: each["after"] for each in json.loads(result.output)["figures"]}
    settings = load_settings(str(out))
    assert settings.mpc.slip.gain_m == told["mpc.slip.gain_m"]
    assert settings.mpc.yaw.lag_s == told["mpc.yaw.lag_s"]
    assert settings.turn_drive.latency_s == told["turn_drive.latency_s"]
    fitted = {name: getattr(JACKAL, name) for name in ("mpc", "sensors", "turn_drive")}
    assert replace(settings, **fitted) == JACKAL
    comments = [line for line in out.read_text().splitlines() if line.startswith("#")]
    assert comments == [
        line for line in Path("config/jackal.yaml").read_text().splitlines() if line.startswith("#")
    ]


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["nowhere.mcap"], 2, "cannot be read"),
        (["--asset", "mocup"], 2, "not driven by velocities"),
        (["--asset", "nobody"], 2, "nobody"),
        (["--write", "--out", "x.yaml"], 2, "choose one"),
        (["--cargo", "900"], 2, "900 kg"),
    ],
)
def test_what_makes_no_sense_is_said(arguments: list[str], status: int, said: str) -> None:
    result = CliRunner().invoke(command, arguments)
    assert result.exit_code == status
    assert said in result.output
    assert "Traceback" not in result.output


def test_the_pattern_is_a_plan_that_the_rover_takes() -> None:
    printed = CliRunner().invoke(command, ["--plan"]).output
    assert printed == plan_xml(JACKAL.drive)
    checked = check_plan(PlanDefinition("a", "a", "BTCPP4", printed.encode()), JACKAL)
    assert not isinstance(checked, Refusal)
