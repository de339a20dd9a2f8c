"""How faults are written: in files, strictly, and in the documentation."""

import re
from math import nan, pi, radians
from pathlib import Path

import pytest

from executive.settings import Sensor, SettingsError
from sim.rover import faults
from sim.rover.faults import (
    FaultTarget,
    Onset,
    Side,
    SimulatedFaultDeclaration,
    bounds,
    declared_faults,
    format_fault,
    read_fault,
    read_kind,
)
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.reading import load_scenario
from sim.scenario.record import Answer


@pytest.mark.parametrize("declaration", declared_faults(), ids=lambda each: each.name)
def test_a_written_fault_is_read(declaration: SimulatedFaultDeclaration) -> None:
    fault = read_fault(declaration.name)
    assert isinstance(fault, declaration.kind)
    assert read_fault(format_fault(fault)) == fault
    assert read_kind(declaration.name) is declaration
    assert declaration.summary.endswith(".")


def test_parameters_have_units_and_degrees() -> None:
    assert read_fault({"odometry_jump": {"by": -1}}) == faults.OdometryJump(-1.0)
    assert read_fault({"tip": {"by": "90deg"}}) == faults.Tip(pi / 2)
    assert read_fault({"gyro_bias": {"rate": "-10 deg"}}) == faults.GyroBias(radians(-10))
    assert read_fault({"motor_dead": {"side": "left"}}) == faults.MotorDead(Side.LEFT)
    assert read_fault({"gyro_dead": {"shared": True}}) == faults.GyroDead(shared=True)
    assert read_fault({"cmd_vel_overridden": {"rate": 10}}) == faults.CmdVelOverridden(rate_hz=10.0)


@pytest.mark.parametrize(
    ("raw", "text"),
    [
        (
            "odometry_lots",
            r"is no fault \(did you mean odometry_lost\?\); known are odometry_lost,",
        ),
        (7, "7 is no fault"),
        ({"low_friction": 0.5}, "low_friction: expected parameters and values, got 0.5"),
        ({"low_friction": {}, "tip": {}}, "is no fault"),
        (
            {"low_friction": {"facter": 0.5}},
            r"unknown key 'facter' \(did you mean factor\?\); known",
        ),
        ({"left_wheels_stuck": {"by": 1}}, "unknown key 'by', it has no parameters"),
        ({"odometry_jump": {"by": 99}}, r"odometry_jump.by: 99 is not in -10 .. 10 m"),
        ({"odometry_jump": {"by": nan}}, "odometry_jump.by: expected a finite number, got nan"),
        ({"odometry_jump": {"by": "90deg"}}, r"odometry_jump.by: expected a number, got '90deg'"),
        ({"low_friction": {"factor": True}}, r"low_friction.factor: expected a number, got True"),
        ({"gyro_bias": {"shared": 1}}, "gyro_bias.shared: expected true or false, got 1"),
        ({"tip": {"by": "far"}}, r"expected a number \(radians, or degrees as 90deg\)"),
        ({"motor_dead": {"side": "top"}}, "motor_dead.side: 'top' is none of left, right, both"),
    ],
)
def test_an_invalid_fault_is_refused(raw: object, text: str) -> None:
    with pytest.raises(ValueError, match=text):
        read_fault(raw)


def row(declaration: SimulatedFaultDeclaration) -> str:
    """Return the row of a fault in the documentation."""
    parameters = []
    for each in declaration.parameters:
        default = declaration.default(each)
        if isinstance(default, bool):
            values, shown = "true, false", str(default).lower()
        elif isinstance(default, Side):
            values, shown = ", ".join(side.value for side in Side), default.value
        else:
            values, shown = "{:g} … {:g}".format(*bounds(each)), f"{default:g}"
        meant = ", ".join(filter(None, (f"{values} {each.unit}".strip(), each.help)))
        parameters.append(f"`{each.name}: {shown}` ({meant})")
    jackal_only = {
        FaultTarget.GYRO,
        FaultTarget.CMD_VEL,
        FaultTarget.ODOMETRY_LINK,
        *Sensor,
    }
    lacks = "MOCUP" if declaration.needs in jackal_only else ""
    lacks = "Jackal" if declaration.needs is FaultTarget.BRICK else lacks
    cells = (f"`{declaration.name}`", declaration.summary, "; ".join(parameters), lacks)
    return f"| {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |")


def test_the_page_has_every_fault() -> None:
    page = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text()
    table = "\n".join(map(row, declared_faults()))
    assert table in page, table


SCENARIO = """\
title: Faults
duration: 5
asset: {asset}
timeline:
  - {{at: 1, command: {{moveForward: {{distance: 0.2}}}}, label: before}}
  - {{at: 1.5, inject: {fault}}}
  - {{at: 2, command: {{takePicture: {{}}}}, label: while}}
  - {{at: 3, clear: {kind}}}
  - {{at: 4, command: {{setTravelSpeed: {{speed: 0.1}}}}, label: after}}
expect:
  - {{command: before, ends: EXECUTED}}
"""


def scenario_file(folder: Path, fault: str, kind: str, asset: str = "jackal") -> str:
    path = folder / "mine.yaml"
    path.write_text(SCENARIO.format(fault=fault, kind=kind, asset=asset))
    return str(path)


def test_a_lost_link_carries_nothing_until_it_is_cleared(tmp_path: Path) -> None:
    name = scenario_file(tmp_path, "link_lost", "link_lost")
    record = run_in_lock_step(load_scenario(name, RunMode.LOCK_STEP), tmp_path)
    answers = {sending.label: sending.answer for sending in record.sendings}
    assert answers == {
        "before": Answer.ACCEPTED,
        "while": Answer.LOST,
        "after": Answer.ACCEPTED,
    }
    lost_s = [value.time_s for value in record.values if 1.6 < value.time_s < 2.9]
    assert not lost_s
    assert record.values[-1].time_s > 3.0


@pytest.mark.parametrize(
    ("fault", "kind", "asset", "text"),
    [
        ("imu_dead", "imu_dead", "mocup", r"timeline\[1\].inject: imu_dead needs a Jackal"),
        ("laser_dead", "laser_dead", "jackal", r"laser_dead needs .* settings\.sensors\.laser"),
        ("gyro_dead", "gyro_dead", "mocup", r"timeline\[1\].inject: gyro_dead needs a gyro, which"),
        (
            "{low_friction: {by: 1}}",
            "low_friction",
            "jackal",
            r"timeline\[1\].inject: low_friction: unknown key 'by'",
        ),
        (
            "{low_friction: {factor: 7}}",
            "low_friction",
            "jackal",
            r"low_friction.factor: 7 is not in 0.01 .. 1",
        ),
        (
            "low_friction",
            "low_frictio",
            "jackal",
            r"timeline\[3\].clear: 'low_frictio' is no fault \(did you mean",
        ),
    ],
)
def test_a_scenario_names_an_unsuitable_fault(
    tmp_path: Path, fault: str, kind: str, asset: str, text: str
) -> None:
    with pytest.raises(SettingsError, match=text):
        load_scenario(scenario_file(tmp_path, fault, kind, asset))


def test_the_page_on_campaigns_groups_every_fault() -> None:
    page = (Path(__file__).parents[2] / "docs" / "campaigns.md").read_text()
    for onset in Onset:
        (row,) = re.findall(rf"^\| `{onset.value}` \|.*$", page, re.MULTILINE)
        named = [name for name in re.findall(r"`(\w+)`", row) if name != onset.value]
        assert named == [each.name for each in declared_faults() if each.onset is onset]
