"""A recording in lock step has everything that a fork of it needs to build its simulation again."""

from contextlib import closing
from pathlib import Path

import pytest

from adapters.recording import RecordingError, RunFile, RunReader, missing_for_fork
from adapters.recording.replay import replay
from adapters.recording.replayed.ports import NullRover
from executive.core.recording import (
    CargoChanged,
    CommandDequeued,
    EmergencyStopped,
    ExecutiveKilled,
    Item,
    LinkDarkChanged,
    ProcessStart,
    SimulatedFaultChanged,
    SimulationItem,
    SimulationStarted,
    SimulationState,
    TimelinePlayed,
    TimelineStarted,
    Truth,
)
from executive.settings import load_settings
from sim.rover import World
from sim.rover.faults import EncoderScale, declared_faults
from sim.rover.lockstep import LockStep
from sim.rover.simulation import Simulation, fault_changed, fault_of
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode, Scenario
from sim.scenario.reading import (
    load_scenario,
    read_scenario,
    read_timeline,
    scenario_folder,
    write_timeline,
)

AT_THE_START = (SimulationStarted, TimelineStarted)
TIMELINE = [
    {"at": 0.5, "command": {"moveTo": {"x": 2.0, "y": 0.1, "heading": "30deg"}}, "label": "go"},
    {"at": 1.0, "inject": {"encoder_scale": {"factor": 1.0 / 3}}},
    {"after": "go STARTED + 1", "clear": "encoder_scale"},
    {"at": 1.6, "cargo": 7.5},
    {"after": "go STARTED + 1.3", "command": "stop", "replace": True},
    {"at": 2.2, "crash": 0.5},
    {"at": 3.0, "outage": 0.5},
    {"after": "go EXECUTED", "command": {"moveForward": {"distance": 1.0}}},
]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    raw = {
        "title": "all that a simulation can do",
        "world": {"friction": 0.7, "scatter": {"count": 9, "seed": 4}},
        "odometry": {"gyro_bias": 0.001},
        "seed": 11,
        "duration": 4.0,
        "timeline": TIMELINE,
        "expect": [{"contacts": 0}],
    }
    return read_scenario(raw, Path("all.yaml"), RunMode.LOCK_STEP)


@pytest.fixture(scope="module")
def recording(scenario: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("all")
    with closing(RunFile(folder / "run.mcap")) as tape:
        run_in_lock_step(scenario, folder / "data", tape)
    return folder / "run.mcap"


@pytest.fixture(scope="module")
def items(recording: Path) -> list[Item]:
    reader = RunReader(recording)
    return [reader.decoded(message) for message in reader.messages()]


def test_an_emergency_stop_before_the_first_tick_is_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped: list[NullRover] = []
    monkeypatch.setattr(NullRover, "emergency_stop", lambda rover: stopped.append(rover))
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape:
        lock = LockStep(load_settings("jackal"), World(), tmp_path, tape=tape)
        lock.executive.emergency_stop()
        lock.run(0.2)
    assert replay(path).difference is None
    assert len(stopped) == 1


def test_the_simulation_can_be_built_again(scenario: Scenario, items: list[Item]) -> None:
    (started,) = (each for each in items if isinstance(each, SimulationStarted))
    made = Simulation.of(started)
    assert (made.world, made.seed, made.odometry) == (
        *(scenario.world, scenario.seed, scenario.odometry),
    )
    assert started.time_s == 0.0


def test_entries_are_as_in_the_file_and_known_as_played(
    scenario: Scenario, items: list[Item]
) -> None:
    (started,) = (each for each in items if isinstance(each, TimelineStarted))
    assert read_timeline(started.text) == scenario.timeline
    played = [each for each in items if isinstance(each, TimelinePlayed)]
    assert [each.index for each in played] == [0, 1, 2, 3, 4, 5, 6], "the last one never begins"
    times_s = [each.time_s for each in played]
    assert times_s == pytest.approx([0.5, 1.0, 1.5, 1.6, 1.8, 2.2, 3.0], abs=0.06)


def test_each_change_of_the_simulation_is_in_its_order(items: list[Item]) -> None:
    changes = [
        each
        for each in items
        if isinstance(each, SimulationItem | EmergencyStopped | ProcessStart)
        and not isinstance(each, (Truth, SimulationState, TimelinePlayed, *AT_THE_START))
    ]
    match changes:
        case [
            ProcessStart(),
            SimulatedFaultChanged(injected=True) as begun,
            SimulatedFaultChanged(injected=False) as cleared,
            CargoChanged(time_s=1.6, mass_kg=7.5),
            EmergencyStopped(),
            ExecutiveKilled(time_s=2.2),
            ProcessStart(),
            LinkDarkChanged(time_s=3.0, dark=True),
            LinkDarkChanged(dark=False) as end,
        ]:
            assert (begun.time_s, fault_of(begun)) == (1.0, EncoderScale(1.0 / 3))
            assert cleared.time_s == pytest.approx(1.5, abs=0.06)
            assert isinstance(fault_of(cleared), EncoderScale)
            assert end.time_s == pytest.approx(3.5)
        case _:
            pytest.fail(str([type(each).__name__ for each in changes]))


def test_an_emergency_stop_precedes_its_command_and_is_replayed(
    recording: Path, items: list[Item], monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = next(i for i, each in enumerate(items) if isinstance(each, EmergencyStopped))
    dequeued = [i for i, each in enumerate(items) if isinstance(each, CommandDequeued)]
    assert min(i for i in dequeued if i > stop) - stop < 5
    stopped: list[NullRover] = []
    monkeypatch.setattr(NullRover, "emergency_stop", lambda rover: stopped.append(rover))
    replayed = replay(recording)
    assert (replayed.difference, replayed.starts) == (None, 2)
    assert len(stopped) == 1


def test_the_missing_parts_of_a_recording_are_named(items: list[Item]) -> None:
    kinds = {type(each) for each in items}
    assert missing_for_fork(kinds) == ()
    (line,) = missing_for_fork(kinds - {TimelineStarted})
    assert line.startswith("/sim/timeline is missing: the reports that commands")


@pytest.mark.parametrize("text", ["{", "[" * 100_000])
def test_a_text_that_cannot_be_read_is_a_bad_recording(text: str, tmp_path: Path) -> None:
    with closing(RunFile(tmp_path / "bad.mcap")) as tape:
        tape.put(SimulationStarted(0.0, text))
    reader = RunReader(tmp_path / "bad.mcap")
    (message,) = reader.messages()
    with pytest.raises(RecordingError, match="/sim/world cannot be decoded"):
        reader.decoded(message)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ('{"world": {"fricton": 1}}', "world: unknown key 'fricton'"),
        (
            '{"world": {}, "picture": {"width": 9999}}',
            "picture.width: 9999 is not in 1 .. 1280",
        ),
        ("3", "expected keys and values"),
    ],
)
def test_an_invalid_simulation_is_named_by_its_key(text: str, fault: str) -> None:
    with pytest.raises(ValueError, match="/sim/world of the recording") as raised:
        Simulation.of(SimulationStarted(0.0, text))
    assert fault in str(raised.value)


def test_the_simulation_takes_less_than_a_tenth_of_a_recording(stuck: Path, tmp_path: Path) -> None:
    reader = RunReader(stuck)
    with closing(RunFile(tmp_path / "without.mcap")) as tape:
        for message in reader.messages():
            item = reader.decoded(message)
            if isinstance(item, Truth) or not isinstance(item, SimulationItem | EmergencyStopped):
                tape.put(item)
    size_octets, before_octets = (
        path.stat().st_size for path in (stuck, tmp_path / "without.mcap")
    )
    assert 1.0 < size_octets / before_octets < 1.1


@pytest.mark.parametrize("name", sorted(path.stem for path in scenario_folder().glob("*.yaml")))
def test_every_timeline_can_be_recorded(name: str) -> None:
    timeline = load_scenario(name).timeline
    assert read_timeline(write_timeline(timeline)) == timeline


def test_every_fault_can_be_recorded() -> None:
    for each in declared_faults():
        fault = each.kind()
        assert fault_of(fault_changed(1.0, each.kind, fault)) == fault
        assert type(fault_of(fault_changed(1.0, each.kind, None))) is each.kind
