"""`LockStep.skip`: hours of standing pass at once, and change nothing that is not documented."""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import pytest

from executive.commands import ActivatePlan, Command, PlanDefinition, Request, SubmitPlan
from executive.commands.lifecycle import Accepted
from executive.plans import FORMAT
from executive.settings import LaserSettings, SecondOdometrySettings, load_settings
from executive.values.reports import Identity, PlanStatus, Severity
from sim.rover import World
from sim.rover.faults import BatterySilent, OdometryDrift, OdometryJitter
from sim.rover.lockstep import MAX_SKIP_S, LockStep

BEGIN_UTC_S: Final = 1_795_000_000.0
PLAN: Final = b"""
<root BTCPP_format="4"><BehaviorTree ID="M"><Sequence>
  <moveTo x="0.5" y="0" deadline_s="60"/>
  <Sleep msec="7200000"/>
  <moveTo x="0" y="0" deadline_s="60"/>
</Sequence></BehaviorTree></root>"""


@pytest.fixture
def lock(tmp_path: Path) -> LockStep:
    """Return a rover in lock step that skips."""
    world = World(sun_w=30.0)
    settings = load_settings("jackal")
    return LockStep(settings, world, tmp_path, start_utc_s=BEGIN_UTC_S, skips=True)


def _send(lock: LockStep, number: int, request: Request) -> None:
    command = Command(Identity("MOE", number), request, "direct", lock.clock.utc_s())
    assert isinstance(lock.submit(command), Accepted)


def test_hours_of_a_plan_pass_at_once(lock: LockStep) -> None:
    """The sleep ends on its tick, no monitor reports a fault, and the battery continues."""
    lock.run(1.0)
    _send(lock, 1, SubmitPlan(PlanDefinition("p", "p.xml", FORMAT, PLAN)))
    _send(lock, 2, ActivatePlan("p"))
    skipped_s, skips = 0.0, 0
    while lock.downlink_record.plans[-1].status is not PlanStatus.COMPLETED:
        assert lock.time_s < 8000
        lock.run(lock.settings.tick_s)
        lock.executive.ground.record_contact()
        now_s = lock.skip()
        skipped_s, skips = skipped_s + now_s, skips + (now_s > 0)
    assert skipped_s > 7000
    assert skips >= skipped_s / MAX_SKIP_S
    moves = [each for each in lock.downlink_record.reports if "done in" in each.text]
    slept_s = moves[1].utc_s - moves[0].utc_s
    assert 7201 < slept_s < 7202.5
    worrying = [
        each.text
        for each in lock.downlink_record.reports
        if each.severity is not Severity.INFORMATIONAL
    ]
    assert not worrying
    assert lock.rover.energy_j == pytest.approx(30 * lock.time_s, rel=0.02)
    charge = lock.executive.status.battery
    assert charge is not None
    assert charge.charge_ratio == pytest.approx(World().charge_ratio, abs=0.001)
    assert lock.clock.utc_s() == pytest.approx(BEGIN_UTC_S + lock.time_s)


def test_a_rover_that_does_not_rest_does_not_skip(lock: LockStep) -> None:
    """Neither a fault that grows nor a moving rover is skipped; a silent battery is."""

    def skipped_s() -> float:
        found = 0.0
        for _ in range(80):
            lock.run(lock.settings.tick_s)
            found += lock.skip()
        return found

    lock.rover.inject(OdometryDrift())
    assert not skipped_s()
    lock.rover.clear(OdometryDrift)
    lock.rover.inject(BatterySilent())
    assert skipped_s()


def test_delayed_odometry_is_not_silent_after_a_skip(lock: LockStep) -> None:
    """The last odometry ages by the delay alone, and not by the skipped time."""
    lock.rover.inject(OdometryJitter(stall_s=0.2))
    skips = 0
    for _ in range(400):
        lock.run(lock.settings.tick_s)
        skips += lock.skip() > 0
    assert skips > 15
    texts = [each.text for each in lock.downlink_record.reports]
    assert not [text for text in texts if "odometry" in text]


def test_a_rover_with_second_odometry_does_not_skip(tmp_path: Path) -> None:
    """Its monitor would report it as silent."""
    lock = _with(tmp_path, second_odometry=SecondOdometrySettings(rate_hz=2.0))
    for _ in range(100):
        lock.run(lock.settings.tick_s)
        assert lock.skip() == 0.0
    assert not lock.downlink_record.reports


def test_no_sensor_is_silent_after_a_skip_with_a_laser(tmp_path: Path) -> None:
    """A scan that is in transit at the begin does not arrive at the end."""
    lock = _with(tmp_path, laser=LaserSettings(10.0))
    skips = 0
    for _ in range(100):
        lock.run(lock.settings.tick_s)
        skips += lock.skip() > 0
    assert skips > 2
    assert not lock.downlink_record.reports


def _with(folder: Path, **own: Any) -> LockStep:
    """Return a rover with further sensors."""
    settings = load_settings("jackal")
    sensors = replace(settings.sensors, **own)
    return LockStep(replace(settings, sensors=sensors), World(), folder, skips=True)


def test_a_step_after_a_delay_is_skipped(lock: LockStep) -> None:
    """The delay has passed, and is no timer any longer."""
    plan = PLAN.replace(b"<Sleep", b'<Delay delay_msec="3000"><Sleep')
    plan = plan.replace(b'7200000"/>', b'7200000"/></Delay>')
    lock.run(1.0)
    _send(lock, 1, SubmitPlan(PlanDefinition("p", "p.xml", FORMAT, plan)))
    _send(lock, 2, ActivatePlan("p"))
    skipped_s = 0.0
    for _ in range(250):
        lock.run(lock.settings.tick_s)
        lock.executive.ground.record_contact()
        skipped_s += lock.skip()
    assert skipped_s > 500.0
