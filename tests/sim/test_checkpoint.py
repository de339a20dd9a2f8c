"""A rover continued from its checkpoint in a new object is the same rover, to the last bit."""

import json
from collections.abc import Iterator
from dataclasses import is_dataclass, replace
from itertools import cycle
from operator import length_hint
from pathlib import Path
from random import Random
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from executive.core.recording import Item, SimulationState
from executive.settings import LaserSettings, SecondOdometrySettings, load_settings
from executive.values.facts import Fact
from executive.values.geometry import Pose, Velocity
from executive.values.ports import CameraIntent
from sim.checkpoint import Checkpointed, CheckpointError
from sim.rover import faults
from sim.rover.camera import PictureSettings
from sim.rover.faults import SimulatedFault, declared_faults, unsupported_reason
from sim.rover.features import FrictionPatch
from sim.rover.jackal import SimulatedJackal, WheelOdometry
from sim.rover.lockstep import LockStep
from sim.rover.mocup import SimulatedMocup
from sim.rover.world import Rock, SoilShape, World
from tests.support.examples import in_full

SETTINGS = load_settings("jackal")
SENSORS = replace(
    SETTINGS.sensors, laser=LaserSettings(10.0), second_odometry=SecondOdometrySettings(10.0)
)
FLAT = World(rocks=(Rock(1.0, 0.0, 0.2, 0.1),), sun_w=20.0)
HILLS = World(
    ground=SoilShape(0.3, size_m=8.0),
    slope_rad=0.05,
    patches=(FrictionPatch(x_m=0.3, y_m=0.0, length_m=0.2, width_m=2.0, friction=0.2),),
)
Seen = list[tuple[Pose, Velocity, int, float, list[Fact]]]


def _rover(world: World) -> SimulatedJackal:
    return SimulatedJackal(world, 7, None, PictureSettings(32, 24), SENSORS, SETTINGS.mux)


def _faults() -> Iterator[SimulatedFault]:
    parts = _rover(FLAT).parts
    for each in declared_faults():
        if unsupported_reason(each.kind, parts) is None:
            yield each.kind()


ALL = tuple(_faults())


def _drive(rover: SimulatedJackal, steps: int, seen: Seen) -> None:
    """Drive for steps of 10 ms, with pictures and movements of the head."""
    begin = round(rover.time_s * 100)
    for step in range(begin, begin + steps):
        if step % 5 == 0:
            rover.drive(Velocity(0.6, 0.5 if step % 100 < 50 else -0.5))
        if step % 40 == 20:
            rover.request_frame()
            rover.point_camera(CameraIntent(step % 3 - 1.0, 0.3, 1.0))
        rover.advance(0.01)
        facts = rover.facts()
        seen.append((rover.true_pose, rover.true_velocity, rover.contacts, rover.energy_j, facts))


GROUPS = tuple(ALL[start::5] for start in range(5))


@pytest.mark.parametrize(
    ("group", "world"),
    [
        *((group, world) for group, world in zip(GROUPS, cycle((FLAT, HILLS)))),
        *(in_full((each,), world) for each, world in zip(ALL, cycle((HILLS, FLAT)))),
    ],
)
def test_a_restored_rover_continues_bit_for_bit(
    group: tuple[SimulatedFault, ...], world: World
) -> None:
    random = Random(str(group))
    first, ignored = _rover(world), Seen()
    first.set_cargo_mass(random.choice((0.0, 5.0)))
    _drive(first, random.randrange(20, 60), ignored)
    for fault in group:
        first.inject(fault)
    _drive(first, random.randrange(1, 60), ignored)
    second = _rover(world)
    second.restore(first.save())
    assert second.save() == first.save()
    runs = Seen(), Seen()
    for rover, seen in zip((first, second), runs, strict=True):
        _drive(rover, 45, seen)
        for fault in group:
            rover.clear(type(fault))
        _drive(rover, 20, seen)
        for fault in (*group, faults.LowFriction()):
            rover.inject(fault)
        _drive(rover, 20, seen)
    assert repr(runs[0]) == repr(runs[1])  # NaN is not equal to NaN


def _state(value: Any) -> str:
    """Return the state of plain data, not of MuJoCo and of functions."""
    match value:
        case np.random.Generator():
            return repr(value.bit_generator.state)
        case np.ndarray() | mujoco.MjModel() | mujoco.MjData():
            return ""
        case Iterator():
            return str(length_hint(value))
        case _ if callable(value) and not isinstance(value, type):
            return ""
        case _:
            return repr(value)


def _attributes(part: Any) -> dict[str, str]:
    """Return the state of each attribute of a rover and its parts, by class and name."""
    found: dict[str, str] = {}
    for name, value in vars(part).items():
        parts = [
            each
            for each in (value if isinstance(value, tuple) else (value,))
            if type(each).__module__.startswith("sim.")
            and not is_dataclass(each)
            and name not in {"_rover", "_renderer"}
        ]
        if parts:
            for each in parts:
                found |= _attributes(each)
        else:
            found[f"{type(part).__name__}.{name}"] = _state(value)
    return found


def _declared(part: Any) -> set[str]:
    declared: set[str] = set()
    for name, kind in part.CHANGES.items():
        value = getattr(part, name)
        if kind is Checkpointed:
            for each in value if isinstance(value, tuple) else (value,):
                declared |= _declared(each)
        else:
            declared.add(f"{type(part).__name__}.{name}")
    return declared


BEHIND = {
    "SimulatedJackal._faults": "SimulatedJackal._active",
    "Disturbance._grip_ratio": "SimulatedJackal._active",
    "InertialUnit._known": "InertialUnit.begun",
    "VisualOdometry._known": "VisualOdometry.begun",
    "NormalRows._rows": "NormalRows.position",
    "NormalRows._before": "NormalRows.position",
    "NormalRows._random": "NormalRows.position",
    "InertialUnit._random": "NormalRows.position",
    "WheelSensors._random": "NormalRows.position",
    "Camera._renderer": "no state: made for the first picture",
}
"""Attributes that change, and are saved under another name."""


def test_every_attribute_that_changes_is_declared(monkeypatch: pytest.MonkeyPatch) -> None:
    """An attribute that is added and not declared is named here."""
    rover = _rover(HILLS)
    before, changed = _attributes(rover), set[str]()
    for fault in ALL:
        rover.inject(fault)
        _drive(rover, 25, Seen())
        now = _attributes(rover)
        changed |= {name for name, state in now.items() if state != before[name]}
        rover.clear(type(fault))
    assert changed - _declared(rover) <= BEHIND.keys()
    kinds = {**WheelOdometry.CHANGES}
    kinds.pop("pose")
    monkeypatch.setattr(WheelOdometry, "CHANGES", kinds)
    assert changed - _declared(rover) - BEHIND.keys() == {"WheelOdometry.pose"}


def test_a_damaged_text_is_one_clear_error() -> None:
    text = _rover(FLAT).save()
    document = json.loads(text)
    other = [*document]
    other[1] = other[1][:-1]
    for damaged in (
        "",
        text[:-1],
        json.dumps(document[:-1]),
        json.dumps(other),
        text.replace("false", '"no"', 1).replace("0.0", "null", 1),
        '{"cargo_kg": 1}',
        "not JSON",
        "[" * 100_000,
    ):
        with pytest.raises(CheckpointError, match="damaged or of another version"):
            _rover(FLAT).restore(damaged)


def test_a_rover_with_other_parts_refuses_a_checkpoint() -> None:
    text = _rover(FLAT).save()
    with pytest.raises(CheckpointError):
        SimulatedJackal(FLAT, 7, None, None, SETTINGS.sensors, SETTINGS.mux).restore(text)
    with pytest.raises(CheckpointError):
        SimulatedJackal(FLAT, 7, None, None, SENSORS).restore(text)


def test_a_recording_in_lock_step_has_the_state_of_each_second(tmp_path: Path) -> None:
    items: list[Item] = []
    tape = SimpleNamespace(put=items.append)
    LockStep(SETTINGS, FLAT, tmp_path / "silent", 7).run(0.1)
    lock = LockStep(SETTINGS, FLAT, tmp_path, 7, tape=tape)
    lock.run(2.5)
    states = [each for each in items if isinstance(each, SimulationState)]
    assert [each.time_s for each in states] == [0.08, 1.08, 2.08]
    rover = SimulatedJackal(FLAT, 7, None, None, SETTINGS.sensors, SETTINGS.mux)
    rover.restore(states[-1].text)
    rover.advance(lock.time_s - states[-1].time_s)
    assert rover.true_pose == lock.rover.true_pose


def test_mocup_refuses_to_be_saved_without_its_brick() -> None:
    with pytest.raises(CheckpointError, match="brick"):
        SimulatedMocup(World()).save()
