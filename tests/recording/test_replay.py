"""A recorded run is replayed equally, a changed rule is noticed, and a bad file is told."""

import json
import re
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from mcap.writer import Writer

from adapters.recording import RecordingError, RunFile
from adapters.recording.commands import BAD_FILE, DIFFERS, SAME
from adapters.recording.commands import replay as replay_command
from adapters.recording.replay import replay
from adapters.recording.rows import RowWriter
from adapters.recording.run_file import PROFILE, RUN, RunReader
from executive.commands import (
    Command,
    DriveFor,
    ExecuteAction,
    Mode,
    MoveForward,
    OnlyAt,
    Precondition,
    Request,
    Resume,
    SetTravelSpeed,
    Stop,
)
from executive.core.authority import AuthorityAction, AuthorityRequest, AuthorityState
from executive.core.recording import LedgerBehind, SolverResult, VideoSwitched
from executive.core.runner import Executive
from executive.goals import GoalQueue
from executive.motion import Arbiter
from executive.motion.velocity_control import DriveLaw
from executive.record import Ledger, Notifications, Synchronous
from executive.settings import config_folder, load_settings
from executive.values.clock import ManualClock
from executive.values.facts import ForeignMuxInput, Odometry
from executive.values.geometry import STANDING, Pose, Velocity
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Severity, Stage
from sim.scenario.changes import Override
from sim.scenario.lockstep_run import run_in_lock_step
from sim.scenario.model import RunMode
from sim.scenario.outcome import digest_of
from sim.scenario.reading import load_scenario
from tests.core.test_ledger_writer import SlowDisk, submitted
from tests.support.kinematic import STEP_S, Bench, KinematicRover
from trees import RoverTree


def recorded(name: str, folder: Path, *changes: str) -> Path:
    """Play a scenario and return its recording."""
    path = folder / f"{name}.mcap"
    made = tuple(Override.parse(each) for each in changes)
    scenario = load_scenario(name, RunMode.LOCK_STEP, made)
    with closing(RunFile(path)) as tape:
        run_in_lock_step(scenario, folder / name, tape)
    return path


@pytest.fixture(scope="module")
def recording_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Give the recording of a scenario, which is played once; nobody changes the file."""
    return cache(lambda name: recorded(name, tmp_path_factory.mktemp(name)))


@pytest.fixture(scope="module")
def drive(recording_of: Callable[[str], Path]) -> Path:
    """Give the recording of a drive with turns and a picture."""
    return recording_of("drive3m_turn_picture")


@pytest.fixture(scope="module")
def turn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give the recording of a turn that has begun."""
    return recorded("motion_turn", tmp_path_factory.mktemp("turn"), "duration=1.5")


@pytest.fixture(scope="module")
def whole_ticks(flushed: Path) -> int:
    """Give how many ticks a recording has that was not cut."""
    return replay(flushed).ticks


def typed(*files: Path) -> Result:
    return CliRunner().invoke(replay_command, list(map(str, files)), catch_exceptions=False)


@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("killed", 2),  # kill -9 within a drive, and another start on the same ledger
        ("takeover", 1),  # stops, a resume
        ("files", 1),  # pictures that are stored, moved and deleted
        ("replaced", 1),  # velocities that replace each other
        ("mocup_picture", 1),  # a rover that moves by itself
    ],
)
def test_a_scenario_is_replayed_equally(
    name: str, runs: int, recording_of: Callable[[str], Path]
) -> None:
    replayed = replay(recording_of(name))
    assert replayed.difference is None
    assert replayed.whole
    assert replayed.starts == runs
    assert replayed.ticks > 100
    assert replayed.decisions > 30


def test_what_holds_over_crashes_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(tmp_path / "bench", tape=tape) as bench:
        bench.rover.pose = Pose(x_m=1.0)  # odometry jumps
        bench.run(0.5)
        bench.crash()
        bench.run(0.5)
        assert bench.executive.mode.name == "SAFE"
        assert "odometry jumped by 1.00 m" in bench.executive.why
        bench.submit(Resume(), 1)
        bench.submit(MoveForward(5.0), 2)
        bench.run(2.0)
        bench.clock.advance(12.0)  # suspended
        bench.step()
        bench.crash()
        bench.run(0.5)
        assert bench.executive.mode.name == "PAUSED"
        bench.submit(Resume(), 3)
        bench.fill_disk()
        bench.submit(MoveForward(5.0), 4)
        bench.run(0.5)
        bench.crash()
        bench.run(0.5)
        assert bench.executive.mode.name == "SAFE"
        bench.submit(Resume(), 5)
        bench.run(3.0)
        bench.rover.velocity = Velocity(0.3)
        for _ in range(40):
            bench.executive.observe(ForeignMuxInput("external", overrides=False))
            bench.step()
        bench.rover.velocity = STANDING
        bench.run(1.0)
        assert any(
            "external, duration 1.95 s, driven 0." in each.text for each in bench.received.reports
        )
    replayed = replay(path)
    assert replayed.difference is None
    assert replayed.starts == 4


def test_the_answers_of_the_solver_are_replayed(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    path = recorded("zones", tmp_path, "settings.controller=mpc", "duration=5")
    answers = list(RunReader(path).messages({SolverResult}))
    assert len(answers) > 10
    assert replay(path).difference is None


def test_the_recorded_run_is_the_same_as_one_that_is_not(tmp_path: Path) -> None:
    scenario = load_scenario("mocup_picture", RunMode.LOCK_STEP)
    with closing(RunFile(tmp_path / "run.mcap")) as tape:
        with_tape = run_in_lock_step(scenario, tmp_path / "with", tape)
    assert digest_of(with_tape) == digest_of(run_in_lock_step(scenario, tmp_path / "without"))


def _other_gain(patch: pytest.MonkeyPatch) -> None:
    want = DriveLaw.intent

    def less(law: DriveLaw, now_s: float) -> Velocity:
        wanted = want(law, now_s)
        return replace(wanted, rotate_radps=0.99 * wanted.rotate_radps)

    patch.setattr(DriveLaw, "intent", less)


def _no_latch(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Arbiter, "stop", Arbiter.zero_velocity)


def _other_mode(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(GoalQueue, "__len__", lambda self: self.waiting)


MUTANTS = [_other_gain, _no_latch, _other_mode]


def test_a_changed_rule_is_noticed(
    drive: Path, recording_of: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    held = recording_of("takeover")
    for mutate in MUTANTS:
        with monkeypatch.context() as patch:
            mutate(patch)
            found = any(replay(path).difference for path in (drive, held))
        assert found, mutate.__name__
    assert [replay(path).difference for path in (drive, held)] == [None, None]


def test_the_first_difference_is_shown(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert " are the same (" in typed(drive).output
    _other_gain(monkeypatch)
    reported = typed(drive)
    assert reported.exit_code == DIFFERS
    first, part = reported.output.splitlines()
    assert "decisions differ after 0.60 s, in entry " in first
    assert part.startswith("  /out/velocity_commanded velocity.rotate_radps: recorded 8.24")
    assert ", replayed 8.16" in part


def test_the_tree_is_shown_where_it_is_another_one(
    drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(DriveLaw, "done", property(lambda _: True))
    reported = typed(drive)
    assert reported.exit_code == DIFFERS
    assert re.search(r"drive .*recorded: RUNNING", reported.output), reported.output


def test_a_core_that_raises_is_reported(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Arbiter, "commit", lambda *_: 1 / 0)
    reported = typed(drive)
    assert reported.exit_code == DIFFERS
    assert "  replayed: ZeroDivisionError: division by zero (line " in reported.output


def test_other_settings_are_tried(tmp_path: Path) -> None:
    path = recorded("side_stuck", tmp_path, "duration=5")
    ignoring = tmp_path / "ignoring.yaml"
    jackal = (config_folder() / "jackal.yaml").read_text()
    ignoring.write_text(
        jackal.replace("\nfaults:\n", "\nfaults:\n  wheels_off_command: {reaction: ignore}\n")
    )
    reported = CliRunner().invoke(replay_command, [str(path), "--with", str(ignoring)]).output
    assert "decisions differ after" in reported
    assert "recorded at 2.25 s: MOE:1  FAILED  the left wheels do not follow" in reported
    assert "replayed at 2.35 s: MOE:1  FAILED  the left wheels do not follow" in reported
    assert "predicted" not in reported, "says the same"
    for bad, why in (("mocup", "is of jackal, not of mocup"), ("none", "no asset")):
        refused = CliRunner().invoke(replay_command, [str(path), "--with", bad])
        assert refused.exit_code == BAD_FILE
        assert why in refused.output


def test_all_recordings_in_a_folder_are_replayed(drive: Path, tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "run.mcap").write_bytes(drive.read_bytes())
    reported = typed(tmp_path)
    assert reported.exit_code == SAME
    assert reported.output.endswith("2 of 2 recordings decide the same\n")
    (tmp_path / "empty").mkdir()
    refused = typed(tmp_path / "empty")
    assert refused.exit_code == BAD_FILE
    assert "contains no recording" in refused.output


def test_a_decision_that_is_lacking_is_shown(drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Arbiter, "commit", lambda *_: None)
    _, then, now = typed(drive).output.splitlines()
    assert then.startswith("  recorded: /out/")
    assert now.startswith("  replayed: ")
    assert now[12:] != then[12:]


@pytest.mark.parametrize("part", [0.02, 0.3, 0.8])
def test_records_written_before_a_crash_are_replayed(
    flushed: Path, whole_ticks: int, part: float, tmp_path: Path
) -> None:
    octets = flushed.read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(octets[: round(len(octets) * part)])
    reported = typed(cut)
    assert reported.exit_code in (0, BAD_FILE)
    if reported.exit_code == 0:
        assert reported.output.endswith("the recording is truncated there\n")
        assert replay(cut).ticks < whole_ticks
    else:
        assert "contains no run" in reported.output


def _with_profile(profile: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile, "another")
            writer.finish()

    return write


def _write(path: Path, batch: bytes) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(PROFILE, "rover-executive")
        writer.add_message(writer.register_channel(RUN, "json", 0), 0, batch, 0, 1)
        writer.finish()


def _with_message(topic: str, plain: dict[str, object]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        rows = RowWriter()
        rows.put(topic, plain)
        batch = rows.take()
        assert batch is not None
        _write(path, batch)

    return write


@pytest.mark.parametrize(
    ("make", "reported"),
    [
        (lambda _: None, "cannot be read (No such file or directory)"),
        (lambda path: path.write_bytes(b""), "contains no run"),
        (lambda path: path.write_bytes(b"text, and no recording"), "is no MCAP file"),
        (_with_profile(""), "is an export of telemetry, or of another program, not a recording"),
        (
            _with_profile("ros2"),
            f"is no recording of this version ({PROFILE}), but MCAP of profile 'ros2'",
        ),
        (
            _with_profile("rover-run-3"),
            f"is a recording of another version (rover-run-3, not {PROFILE}): record the run again",
        ),
        (_with_message("/start", {}), "message of /start cannot be decoded"),
        (_with_message("/in/tick", {"call": []}), "message of /in/tick cannot be decoded"),
        (
            _with_message("/in/tick", {"now_s": 1.0, "utc_s": 1.0, "call": "TICK"}),
            "begins in the middle, without /start",
        ),
    ],
)
def test_a_file_that_is_no_recording_is_reported(
    make: Callable[[Path], None], reported: str, tmp_path: Path, turn: Path
) -> None:
    path = tmp_path / "run.mcap"
    make(path)
    result = typed(path, turn)
    assert result.exit_code == BAD_FILE
    first, second, summary = result.output.splitlines()
    assert first.startswith(f"Error: {path}: ")
    assert reported in first
    assert "are the same" in second
    assert summary == "1 of 2 recordings decide the same"


def test_a_full_disk_ends_the_recording_and_not_the_run(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    scenario = load_scenario("mocup_picture", RunMode.LOCK_STEP)
    with closing(RunFile(Path("/dev/full"))) as tape:
        record = run_in_lock_step(scenario, tmp_path, tape)
    assert record.simulated_s == scenario.duration_s
    warnings = [each.getMessage() for each in caplog.records if "recording" in each.getMessage()]
    assert warnings == ["recording /dev/full ends: No space left on device"]


class Recording:
    """An executive over a rover without physics, recorded in a file."""

    def __init__(self, folder: Path, rover: KinematicRover | None = None) -> None:
        self.path = folder / "run.mcap"
        self.tape = RunFile(self.path)
        self.clock = ManualClock()
        self.rover = rover or KinematicRover()
        self.executive = Executive(
            settings=load_settings("jackal"),
            clock=self.clock,
            rover=self.rover,
            ledger=Ledger(folder / "ledger.sqlite", Synchronous.NORMAL),
            files=folder / "files",
            downlinks=[],
            build_tree=RoverTree,
            tape=self.tape,
        )

    def submit(
        self,
        number: int,
        request: Request,
        authority: int | None = None,
        only: Precondition | None = None,
    ) -> None:
        identity = Identity("MOE", number)
        command = Command(identity, request, "direct", authority=authority, precondition=only)
        self.executive.submit(command, lambda _: None)

    def step(self) -> None:
        self.clock.advance(STEP_S)
        self.rover.advance(STEP_S)
        fact = Odometry(self.clock.now_s(), self.rover.pose, self.rover.velocity)
        self.executive.observe(fact)
        self.executive.tick()


def test_preconditions_are_replayed(tmp_path: Path) -> None:
    made = Recording(tmp_path)
    made.step()
    made.submit(1, MoveForward(0.2), only=Precondition(OnlyAt(0.0, 0.0, 0.5, 0.0, 0.1)))
    made.submit(2, MoveForward(0.1), only=Precondition(after=1, mode=Mode.MOVING))
    made.submit(3, MoveForward(0.1), only=Precondition(OnlyAt(9.0, 0.0, 0.5)))
    for _ in range(60):
        made.step()
    ends = [each.stage for each in made.executive.reports() if each.stage and each.stage.terminal]
    assert ends == [Stage.REJECTED, Stage.EXECUTED, Stage.EXECUTED]
    made.executive.close()
    made.tape.close()
    assert replay(made.path).difference is None


def test_overtaking_stops_and_events_of_others_are_replayed(tmp_path: Path) -> None:
    made = Recording(tmp_path)
    made.step()
    made.submit(1, MoveForward(1.0))
    made.submit(2, Resume())
    made.submit(3, Stop())
    made.submit(4, DriveFor(0.1, 0.0, 1.0))
    made.submit(3, Stop())
    for _ in range(10):
        made.step()
    made.executive.report_event(Severity.WARNING, "a link\nis slow")
    made.submit(5, Resume())
    made.executive.serve_inbox()
    made.submit(6, MoveForward(1.0))
    made.step()
    made.executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung"))
    made.step()
    made.executive.close()
    made.tape.close()
    replayed = replay(made.path)
    assert replayed.difference is None
    assert (replayed.ticks, replayed.entries) == (13, 13 + 13 + 5)


def test_a_rover_without_the_video_of_its_settings_is_replayed_without(tmp_path: Path) -> None:
    made = Recording(tmp_path)
    assert load_settings("jackal").video is not None
    made.submit(1, ExecuteAction("VIDEO ON"))
    made.step()
    made.executive.close()
    made.tape.close()
    assert replay(made.path).difference is None


def test_the_destination_of_the_video_is_recorded(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(tmp_path, tape=tape) as bench:
        bench.execute(ExecuteAction("VIDEO ON"), 1)
        assert bench.video.enabled
    assert replay(path).difference is None
    switched = [each for each in RunReader(path).messages() if each.topic.kind is VideoSwitched]
    assert [json.loads(each.data) for each in switched] == [{"enabled": True}]


def test_a_ledger_that_cannot_be_written_for_a_while_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, Bench(tmp_path, tape=tape) as bench:
        bench.drive_on()
        bench.fill_disk()
        assert bench.refusal(MoveForward(1.0), 2).reason is Reason.LEDGER_FAILED
        bench.run(0.5)
        bench.fill_disk(full=False)
        bench.run(0.5)
        bench.submit(Resume(), 3)
        bench.execute(MoveForward(0.5), 4)
        bench.fill_disk()
        bench.executive.close()
        bench.restart()
        bench.run(0.5)
        bench.execute(MoveForward(0.5), 5)
    found = replay(path)
    assert (found.difference, found.starts) == (None, 2)
    failed = [each for each in RunReader(path).messages() if each.topic.kind is LedgerBehind]
    assert "readonly" in json.loads(failed[0].data)["error"]


def test_a_run_on_a_slow_disk_is_replayed_though_no_flush_was_cut_short(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    with monkeypatch.context() as patch, closing(RunFile(path)) as tape:
        patch.setattr(Notifications, "waiting", True)  # no flush is an idle one
        with Bench(tmp_path, tape=tape) as bench:
            SlowDisk(bench).commit_s = 0.03
            for number in (1, 2):
                submitted(bench, MoveForward(0.2), number)
                bench.run(3.0)
                assert bench.stages(number)[-1] is Stage.EXECUTED
    behind = [each for each in RunReader(path).messages() if each.topic.kind is LedgerBehind]
    assert any(json.loads(each.data)["polls"] > 0 for each in behind)
    assert replay(path).difference is None


class BenchBesideRelay(Bench):
    """The relay link writes to the ledger before the executive is created."""

    def open_ledger(self) -> Ledger:
        """Open the ledger, with a batch that the recording does not have."""
        ledger = super().open_ledger()
        ledger.add_tables("CREATE TABLE IF NOT EXISTS relayed (number INTEGER)")
        ledger.write("INSERT INTO relayed VALUES (1)")
        ledger.commit()
        return ledger


def test_a_ledger_with_batches_from_before_the_start_is_replayed(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with closing(RunFile(path)) as tape, BenchBesideRelay(tmp_path, tape=tape) as bench:
        SlowDisk(bench).commit_s = 0.12
        submitted(bench, MoveForward(0.2), 1)
        bench.run(3.0)
        assert bench.stages(1)[-1] is Stage.EXECUTED
    assert replay(path).difference is None


def test_what_questions_of_other_threads_do_is_replayed_where_they_did_it(tmp_path: Path) -> None:
    made = Recording(tmp_path)
    core, granted = made.executive, list[AuthorityState | Refusal]()
    made.step()
    made.submit(1, MoveForward(1.0))
    request = requested(AuthorityAction.REQUEST, "MOE")
    core.query(lambda: core.request_authority(request, granted.append))
    core.query(lambda: core.report_event(Severity.WARNING, "a link is slow"))
    made.submit(2, MoveForward(1.0))
    released = requested(AuthorityAction.RELEASE, "MOE", 1)
    core.query(lambda: core.request_authority(released, granted.append))
    made.submit(3, SetTravelSpeed(0.2), authority=1)
    made.step()
    core.query(lambda: core.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung")))
    made.submit(4, MoveForward(1.0))
    made.step()
    assert [isinstance(each, AuthorityState) for each in granted] == [True, True]
    core.close()
    made.tape.close()
    replayed = replay(made.path)
    assert replayed.difference is None
    assert (replayed.ticks, replayed.entries) == (3, 3 + 3 + 2)


def requested(act: AuthorityAction, source: str, epoch: int = 0) -> AuthorityRequest:
    return AuthorityRequest(act, source, epoch)


class StopsInBetween(KinematicRover):
    """Another thread submits a stop, just as the core commands a velocity."""

    def __init__(self) -> None:
        super().__init__()
        self.stop: Callable[[], None] | None = None

    def drive(self, velocity: Velocity) -> None:
        super().drive(velocity)
        if self.stop is not None and velocity != STANDING:
            stop, self.stop = self.stop, None
            stop()


def test_a_stop_that_arrives_during_a_tick_is_replayed(tmp_path: Path) -> None:
    rover = StopsInBetween()
    made = Recording(tmp_path, rover)
    made.step()
    made.submit(1, MoveForward(1.0))
    rover.stop = lambda: made.submit(2, Stop())
    for _ in range(5):
        made.step()
    made.executive.close()
    made.tape.close()
    replayed = replay(made.path)
    assert replayed.difference is None
    assert replayed.ticks == 6


def test_a_recording_that_lacks_its_start_is_reported(tmp_path: Path) -> None:
    made = Recording(tmp_path)
    made.step()
    made.tape.close()
    rows = RowWriter()
    for message in RunReader(made.path).messages():
        if message.topic.name != "/in/start":
            rows.put(message.topic.name, json.loads(message.data))
    batch = rows.take()
    assert batch is not None
    path = tmp_path / "headless.mcap"
    _write(path, batch)
    with pytest.raises(RecordingError, match="precedes /in/start"):
        replay(path)
