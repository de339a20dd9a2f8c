"""A fork is the recorded run with a change, to the last bit."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest

from adapters.recording import RecordingError, RunFile, RunReader, decode
from adapters.recording.replay import replay
from executive.commands import MoveForward, Precondition, PreemptionPolicy, Stop
from executive.core.recording import (
    CommandDequeued,
    Entry,
    FactObserved,
    ProcessStart,
    ReportSent,
    SimulatedFaultChanged,
    SimulationItem,
    SimulationStarted,
    SimulationState,
    TimelineStarted,
    Truth,
)
from executive.settings import Controller, SettingsError, load_settings
from executive.values.facts import Battery
from executive.values.reports import Identity
from sim.fork.forkable import Forkable, whatif
from sim.fork.model import (
    AddedCommand,
    AddedFault,
    Change,
    Fidelity,
    ForkOutcome,
    Placing,
    ReplacedCommand,
    WhatIf,
)
from sim.rover import World
from sim.rover.faults import LeftWheelsStuck
from sim.rover.simulation import Simulation
from sim.scenario.changes import Override
from sim.scenario.truth import true_ends
from tests.fork.conftest import SHORT, play


def stages(outcome: ForkOutcome) -> dict[str, str]:
    return {each.command: f"{each.stage} {each.reason}".strip() for each in outcome.commands}


def rewritten(
    recording: Path, path: Path, seed: int | None = None, without: tuple[type, ...] = ()
) -> Path:
    """Return a copy with another seed, or without the items of these kinds."""
    with closing(RunFile(path)) as file:
        for message in RunReader(recording).messages():
            item = decode(message.topic, message.data)
            if isinstance(item, SimulationStarted) and seed is not None:
                item = replace(Simulation.of(item), seed=seed).started(item.time_s)
            if not isinstance(item, without):
                file.put(item)
    return path


def test_a_fork_without_a_change_is_the_recorded_run(run: Forkable) -> None:
    fork, fidelity = run.unchanged()
    assert fidelity is Fidelity.BIT_EQUAL
    assert fork.outcome.commands == run.recorded.outcome.commands
    assert fork.record.poses == run.recorded.record.poses
    assert fork.odometry == run.recorded.odometry
    assert fork.outcome.first_difference is None
    assert fork.outcome.placing is Placing.PHYSICS
    assert stages(fork.outcome)["MOE:1"] == "FAILED WHEELS_OFF_COMMAND"


def test_a_fork_under_a_setting_is_the_scenario_under_it(run: Forkable, tmp_path: Path) -> None:
    fork = run.fork(Change(settings=(Override("drive.travel_speed_mps", "0.6"),)))
    itself = play(tmp_path, "side_stuck", *SHORT, "settings.drive.travel_speed=0.6")
    assert fork.record.poses[: len(itself.poses)] == itself.poses
    difference = fork.outcome.first_difference
    assert difference is not None
    assert fork.outcome.at_s == difference.time_s < 2.0
    assert difference.topic == "/out/velocity_commanded"
    assert difference.forked.startswith("velocity 0.60 m/s")
    assert difference.recorded.startswith("velocity 0.65 m/s")


def test_a_fork_without_its_fault_continues_until_its_commands_end(answer: WhatIf) -> None:
    (fork,) = answer.forks
    assert answer.fidelity is Fidelity.BIT_EQUAL
    assert stages(fork) == {"MOE:1": "EXECUTED", "MOE:2": "EXECUTED"}
    assert fork.end_s > answer.recorded.end_s
    assert fork.first_difference is not None
    assert 2.0 < fork.first_difference.time_s < 2.25
    assert fork.first_difference.forked_why.startswith("leaf drive ran for ")


def test_the_recording_of_a_fork_replays_and_is_forked_again(answer: WhatIf) -> None:
    file = Path(answer.recording).with_name("fork.mcap")
    assert replay(file).difference is None
    again, fidelity = Forkable(file).unchanged()
    assert fidelity is Fidelity.BIT_EQUAL
    assert again.outcome.commands == answer.forks[0].commands


def test_commands_are_added_dropped_and_replaced(run: Forkable, tmp_path: Path) -> None:
    first = Identity("MOE", 1)
    ahead = AddedCommand(MoveForward(0.5), at_s=1.5, preemption=PreemptionPolicy.REPLACE)
    added = stages(run.fork(Change(added=(ahead,))).outcome)
    assert added["MOE:1"] == "CANCELLED REPLACED"
    assert added["MOE:7"] == "FAILED WHEELS_OFF_COMMAND"
    short = ReplacedCommand(first, MoveForward(0.2))
    assert stages(run.fork(Change(replaced=(short,))).outcome)["MOE:1"] == "EXECUTED"
    dropped = Change(dropped=(first,), faults=(AddedFault(LeftWheelsStuck(), 1.2, 1.6),))
    fork = run.fork(dropped, out=tmp_path / "fork.mcap")
    assert stages(fork.outcome) == {"MOE:2": "EXECUTED"}
    reader = RunReader(tmp_path / "fork.mcap")
    faults = map(reader.decoded, reader.messages({SimulatedFaultChanged}))
    assert [each.injected for each in faults] == [True, False, True]


def test_other_seeds_change_the_noise_behind_the_fork(run: Forkable) -> None:
    first, second = (run.fork(Change(), 1.5, seed) for seed in (None, 1))
    pairs = zip(first.odometry, second.odometry, strict=False)
    apart_s = next(a.time_s for a, b in pairs if a != b)
    assert 1.5 < apart_s < 1.7
    assert stages(first.outcome) == stages(second.outcome)


def test_a_world_and_a_controller_are_changed(run: Forkable) -> None:
    slippery = run.fork(Change(world=World(friction=0.05), seed=5)).outcome
    assert slippery.first_difference is not None
    assert slippery.seed == 5
    with pytest.raises(SettingsError, match=r"--controller navigation: .* section navigation"):
        run.fork(Change(controller=Controller.NAVIGATION))


def test_a_recording_of_another_seed_has_the_same_outcomes(stuck: Path, tmp_path: Path) -> None:
    other = Forkable(rewritten(stuck, tmp_path / "run.mcap", seed=7))
    assert other.unchanged()[1] is Fidelity.SAME_OUTCOMES


def test_the_first_difference_of_an_inexact_fork_is_that_of_its_change(
    stuck: Path, tmp_path: Path
) -> None:
    change = Change(settings=(Override("drive.travel_speed", "0.6"),))
    answer = whatif(rewritten(stuck, tmp_path / "run.mcap", seed=7), change)
    noise, caused = answer.unchanged.first_difference, answer.forks[0].first_difference
    assert answer.fidelity is Fidelity.SAME_OUTCOMES
    assert noise is not None
    assert caused is not None
    assert noise.time_s < caused.time_s, "other noise differs from the recording before"
    assert caused.forked.startswith("velocity 0.60 m/s")


def test_a_recording_without_a_timeline_is_continued_from_its_state(
    stuck: Path, tmp_path: Path
) -> None:
    live = Forkable(rewritten(stuck, tmp_path / "run.mcap", without=(TimelineStarted,)))
    fork, fidelity = live.unchanged(1.5)
    assert fidelity is Fidelity.BIT_EQUAL
    assert fork.outcome.placing is Placing.STATE
    assert fork.outcome.at_s == 1.5
    assert live.unchanged(2.9)[1] is Fidelity.BIT_EQUAL
    assert live.unchanged(3.0)[1] is Fidelity.NOT_COMPARED
    (lacking,) = live.recorded.outcome.lacks
    assert "/sim/timeline is missing" in lacking


def test_a_command_of_a_fork_waits_for_the_same_one(stuck: Path, tmp_path: Path) -> None:
    path, reader = tmp_path / "run.mcap", RunReader(stuck)
    with closing(RunFile(path)) as file:
        for item in map(reader.decoded, reader.messages()):
            if isinstance(item, CommandDequeued):
                unknown = Precondition(after=999)
                item = replace(item, command=replace(item.command, precondition=unknown))
            if not isinstance(item, TimelineStarted):
                file.put(item)
    fork = Forkable(path).fork(Change(), 0.9)
    assert stages(fork.outcome)["MOE:1"] == "REJECTED PRECONDITION_COMMAND"


def test_the_record_of_a_fork_within_a_motion_is_complete(tmp_path: Path) -> None:
    play(tmp_path, "motion_forward", "duration=3", "command.go.distance=0.6")
    without = (TimelineStarted,)
    live = Forkable(rewritten(tmp_path / "run.mcap", tmp_path / "live.mcap", without=without))
    (end,) = true_ends(live.fork(Change(), 1.6).record)
    assert (end.label, end.wrong) == ("MOE:1", "")


def test_a_live_simulation_on_another_clock_is_placed_before_its_first_state(
    stuck: Path, tmp_path: Path
) -> None:
    unknown = (Truth, TimelineStarted, SimulationState)
    path = on_another_clock(rewritten(stuck, tmp_path / "run.mcap", without=unknown))
    fork, fidelity = Forkable(path).unchanged(0.9)
    assert fork.outcome.placing is Placing.ODOMETRY, "the simulation may be older"
    assert fidelity is Fidelity.SAME_OUTCOMES


def on_another_clock(recording: Path) -> Path:
    """Return a copy with the clock of an executive in a process of its own.

    The computer has run for a day, and the battery reports no charge.
    """
    path, reader = recording.with_name("live.mcap"), RunReader(recording)
    with closing(RunFile(path)) as file:
        for item in map(reader.decoded, reader.messages()):
            if isinstance(item, FactObserved) and isinstance(item.fact, Battery):
                item = replace(item, fact=replace(item.fact, charge_ratio=None))
            if isinstance(item, SimulationItem):
                item = replace(item, time_s=item.time_s + 86400.0)
            if isinstance(item, Entry):
                item = replace(item, now_s=item.now_s + 86400.0)
            file.put(item)
    return path


def test_times_of_a_slow_simulation_are_on_its_clock(
    stuck: Path, run: Forkable, tmp_path: Path
) -> None:
    path, reader, recorded = tmp_path / "run.mcap", RunReader(stuck), run.recorded

    def utc_s(exact_s: float) -> float:
        return exact_s + 0.25 * (exact_s - recorded.record.start_utc_s)

    with closing(RunFile(path)) as file:
        for item in map(reader.decoded, reader.messages()):
            if isinstance(item, Entry):
                item = replace(item, utc_s=utc_s(item.utc_s))
            elif isinstance(item, ReportSent):
                item = replace(item, report=replace(item.report, utc_s=utc_s(item.report.utc_s)))
            file.put(item)
    found = Forkable(path).recorded.outcome.commands
    assert [each.pose for each in found] == [each.pose for each in recorded.outcome.commands]
    ends_s = [each.end_s for each in recorded.outcome.commands]
    assert [each.end_s for each in found] == pytest.approx(ends_s, abs=1e-6)


@pytest.mark.parametrize(
    ("without", "placing"),
    [
        (tuple({*get_args(SimulationItem)} - {Truth}), Placing.TRUE_POSE),
        (get_args(SimulationItem), Placing.ODOMETRY),
    ],
)
def test_a_recording_of_a_rover_is_continued_from_its_pose(
    stuck: Path, run: Forkable, tmp_path: Path, without: tuple[type, ...], placing: Placing
) -> None:
    lacking = Forkable(rewritten(stuck, tmp_path / "run.mcap", without=without))
    fork, fidelity = lacking.unchanged()
    assert fidelity is not Fidelity.BIT_EQUAL
    assert fork.outcome.placing is placing
    assert any("the world, its seed" in each for each in lacking.recorded.outcome.lacks)
    change = Change(settings=(Override("drive.travel_speed", "0.6"),))
    fork, exact = lacking.fork(change), run.fork(change)
    assert fork.outcome.at_s == exact.outcome.at_s
    assert fork.outcome.first_difference == exact.outcome.first_difference


def test_a_fork_of_a_rover_is_forked_again(tmp_path: Path) -> None:
    play(tmp_path, "motion_forward", "duration=2.5")
    kinds = get_args(SimulationItem)
    lacking = rewritten(tmp_path / "run.mcap", tmp_path / "lacking.mcap", None, kinds)
    stop = Change(added=(AddedCommand(Stop()),))
    answer = whatif(lacking, stop, at_s=1.5, out=tmp_path / "fork.mcap")
    assert answer.fidelity is Fidelity.SAME_OUTCOMES
    (fork,) = answer.forks
    assert fork.at_s == answer.unchanged.at_s == 1.5
    assert fork.first_difference is not None
    assert fork.first_difference.time_s == 1.5
    assert stages(fork)["MOE:1"] == "CANCELLED STOPPED"
    without = Change(dropped=(Identity("MOE", 2),))
    assert stages(Forkable(tmp_path / "fork.mcap").fork(without).outcome) == {"MOE:1": "EXECUTED"}


def test_a_damaged_ledger_in_a_recording_is_an_error_of_the_recording(
    stuck: Path, tmp_path: Path
) -> None:
    path, reader = tmp_path / "damaged.mcap", RunReader(stuck)
    with closing(RunFile(path)) as file:
        for item in map(reader.decoded, reader.messages()):
            damaged = isinstance(item, ProcessStart)
            file.put(replace(item, ledger=item.ledger[:2000] * 4) if damaged else item)
    with pytest.raises(RecordingError, match=r"damaged\.mcap: ledger"):
        Forkable(path).unchanged()


def test_a_restart_occurs_as_recorded(tmp_path: Path) -> None:
    play(tmp_path, "side_stuck", *SHORT, "crash={at: 1.6, for: 0.5}")
    kinds = get_args(SimulationItem)
    killed = Forkable(rewritten(tmp_path / "run.mcap", tmp_path / "killed.mcap", None, kinds))
    fork, fidelity = killed.unchanged()
    assert fidelity is Fidelity.SAME_OUTCOMES
    assert "FAILED INTERRUPTED" in stages(fork.outcome).values()


def test_odometry_arrives_as_recorded_after_a_restart(tmp_path: Path) -> None:
    late = "inject={odometry_late: {by: 0.2}, at: 2}"
    play(tmp_path, "motion_forward", "duration=3", "crash={at: 0.3, for: 0.4}", late)
    kinds = get_args(SimulationItem)
    unknown = Forkable(rewritten(tmp_path / "run.mcap", tmp_path / "real.mcap", None, kinds))
    fork, fidelity = unknown.unchanged(0.2)
    assert fidelity is Fidelity.SAME_OUTCOMES
    assert stages(fork.outcome) == {"MOE:1": "FAILED ODOMETRY_LATE"}


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ("{odometry_lost, at: 2, for: 0.6}", "ODOMETRY_STALE"),
        ("{odometry_late: {by: 0.2}, at: 2}", "ODOMETRY_LATE"),
        ("{battery_low, at: 1.5}", "BATTERY_LOW"),
    ],
)
def test_odometry_and_battery_of_a_rover_arrive_as_recorded(
    fault: str, reason: str, tmp_path: Path
) -> None:
    play(tmp_path, "motion_forward", "duration=3", f"inject={fault}")
    kinds = get_args(SimulationItem)
    unknown = Forkable(rewritten(tmp_path / "run.mcap", tmp_path / "real.mcap", None, kinds))
    fork, fidelity = unknown.unchanged()
    assert fidelity is Fidelity.SAME_OUTCOMES
    assert stages(fork.outcome) == {"MOE:1": f"FAILED {reason}"}


def test_measured_obstacles_are_the_world_that_a_recording_lacks(tmp_path: Path) -> None:
    rocks = "world.rocks=[{x: 1.5, y: 0.1, radius: 0.3, height: 0.6}]"
    play(tmp_path, "unknown_rocks", "duration=6", rocks, "world.scatter={count: 0}")
    run = Forkable(tmp_path / "run.mcap", exact=False)
    recorded = run.recorded.outcome.pose
    assert recorded is not None
    around, through = (
        run.unchanged(assumed=assumed)[0].outcome.pose for assumed in (Change(scans=True), None)
    )
    assert around is not None
    assert through is not None
    assert around.point.distance_m(recorded.point) < 0.1
    assert through.point.distance_m(recorded.point) > 0.15


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            Change(settings=(Override("drive.sped", "1"),)),
            "drive: unknown key 'sped'.*travel_speed",
        ),
        (Change(settings=(Override("drive.travel_speed", "fast"),)), "travel_speed: "),
        (Change(dropped=(Identity("MOE", 9),)), "no command MOE:9 .* MOE:1, MOE:2"),
        (Change(without=("tip",)), "no fault 'tip' .* left_wheels_stuck"),
        (Change(added=(AddedCommand(MoveForward(1.0)),)), "needs a time: give --at"),
        (Change(asset=load_settings("mocup")), "is of jackal, not of mocup"),
    ],
)
def test_a_change_that_does_not_fit_has_one_clear_error(
    run: Forkable, change: Change, text: str
) -> None:
    with pytest.raises(SettingsError, match=text):
        run.fork(change)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="cannot be read"):
        Forkable(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("no recording")
    with pytest.raises(RecordingError, match="is no MCAP file"):
        Forkable(tmp_path / "text.mcap")
