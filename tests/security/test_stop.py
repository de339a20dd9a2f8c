"""A stop acts: whatever its number, source, time and authority, whatever the core is at."""

import errno
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adapters.mal import MalError
from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import describe_error
from executive.commands import (
    ActivatePlan,
    Command,
    Mode,
    MoveForward,
    Resume,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
)
from executive.commands.lifecycle import Accepted, Duplicate, Rejected, SubmitResult
from executive.record import StopLatch
from executive.settings import AuthoritySettings, load_settings
from executive.values.clock import START_UTC_S
from executive.values.geometry import STANDING
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Identity, Stage
from tests.mrs.aboard import Aboard
from tests.support.kinematic import Bench
from tests.support.plans import PlanBench, plan
from tests.support.requested_authority import RequestedAuthority

ALL_THE_SAME = "the rover was stopped nevertheless"


def stop(number: int = 7, source: str = "MOE", **options: Any) -> Command:
    return Command(Identity(source, number), Stop(), "direct", **options)


@pytest.mark.at_length
@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (stop(1), Reason.DUPLICATE),
        (stop(0), Reason.BAD_IDENTIFIER),
        (stop(source=""), Reason.BAD_IDENTIFIER),
        (stop(source="MOE:1 EXECUTED\n\x1b[31mforged\0"), Reason.BAD_IDENTIFIER),
        (stop(source="plan:survey"), Reason.BAD_IDENTIFIER),
        (stop(source="x" * 100_000), Reason.BAD_IDENTIFIER),
        (stop(peer="MARVIN"), Reason.BAD_IDENTIFIER),
        (stop(created_utc_s=START_UTC_S - 60.0, lifetime_s=5.0), Reason.EXPIRED),
        (stop(created_utc_s=START_UTC_S + 3600.0, lifetime_s=5.0), Reason.CREATED_IN_FUTURE),
    ],
    ids=lambda value: value.name if isinstance(value, Reason) else "",
)
def test_a_stop_that_is_refused_gives_the_reason_and_acts(
    bench: Bench, command: Command, reason: Reason
) -> None:
    bench.drive_on()
    answer = bench.send(command)
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is reason
    assert answer.refusal.text.endswith(ALL_THE_SAME)
    assert answer.refusal.text.isprintable()
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED
    assert bench.executive.why.isprintable()
    bench.run(1.0)
    assert bench.stages(1)[-1] is Stage.CANCELLED
    assert all(report.text.isprintable() for report in bench.received.reports)


def test_a_stop_needs_no_authority(tmp_path: Path) -> None:
    settings = replace(load_settings("jackal"), authority=AuthoritySettings(needed=True))
    with Bench(tmp_path, settings) as bench:
        state = RequestedAuthority(bench).request("MOE")
        assert not isinstance(state, Refusal)
        bench.submit(MoveForward(5.0), 1, authority=state.epoch)
        bench.run(1.0)
        assert bench.rover.velocity != STANDING
        assert isinstance(bench.send(stop(source="MARVIN", authority=99)), Accepted)
        assert bench.rover.velocity == STANDING


@pytest.mark.at_length
def test_stops_of_repeated_numbers_all_act(bench: Bench) -> None:
    acted = 0
    for number in range(200):
        bench.submit(Resume(), 10_000 + number)
        bench.submit(MoveForward(5.0), 20_000 + number)
        bench.run(0.1)
        answer = bench.submit(Stop(), 1 + number % 10)
        assert isinstance(answer, Accepted if number < 10 else Duplicate)
        acted += bench.rover.velocity == STANDING and bench.executive.mode is Mode.STOPPED
    assert acted == 200
    texts = [report.text for report in bench.received.reports]
    assert texts.count("duplicate of MOE:1: the rover was stopped again") == 19


def test_a_stop_acts_on_a_full_disk_and_is_known_after_kill_9(bench: Bench) -> None:
    bench.drive_on()
    bench.fill_disk()
    answer = bench.submit(Stop(), 2)
    assert isinstance(answer, Rejected)
    assert answer.refusal.reason is Reason.LEDGER_FAILED
    assert answer.refusal.text.endswith(ALL_THE_SAME)
    bench.crash()
    assert bench.executive.mode is Mode.STOPPED
    assert "MOE:2" in bench.executive.why
    bench.run(0.2)
    assert bench.refusal(MoveForward(1.0), 3).reason is Reason.WRONG_MODE
    bench.submit(Resume(), 4)
    bench.crash()
    bench.run(0.2)
    bench.execute(MoveForward(1.0), 5)


def test_a_resume_that_was_not_written_down_is_none_after_a_restart(bench: Bench) -> None:
    bench.execute(Stop(), 1)
    bench.fill_disk()
    assert isinstance(bench.submit(Resume(), 2), Rejected)
    bench.crash()
    assert bench.executive.mode is Mode.STOPPED


def test_a_stop_overtakes_what_waits_and_no_resume_before_it_undoes_it(bench: Bench) -> None:
    bench.execute(Stop(), 1)
    answers: list[SubmitResult] = []

    def hand_over(number: int, request: Any) -> None:
        bench.executive.submit(Command(Identity("MOE", number), request, "direct"), answers.append)

    for number in range(100, 200):
        hand_over(number, SetTravelSpeed(0.5))
    hand_over(200, Resume())
    hand_over(201, Stop())
    bench.executive.serve_inbox()
    assert isinstance(answers[0], Accepted)
    assert answers[0].lifecycle.command.identity.command_id == 201
    for _ in range(5):
        bench.executive.serve_inbox()
    assert len(answers) == 102
    resumed = answers[-1]
    assert isinstance(resumed, Rejected)
    assert "stopped by MOE:201" in resumed.refusal.text
    assert bench.executive.mode is Mode.STOPPED


def test_a_flood_of_stops_leaves_time_for_the_ticks(bench: Bench) -> None:
    bench.drive_on()
    answers: list[SubmitResult] = []
    for number in range(1000):
        bench.executive.submit(stop(100 + number), answers.append)
    bench.executive.serve_inbox()
    assert 0 < len(answers) <= 64
    assert bench.executive.mode is Mode.STOPPED
    for _ in range(50):
        bench.executive.serve_inbox()
    assert len(answers) == 1000
    assert all(isinstance(answer, Accepted) for answer in answers)


def test_the_rover_is_stationary_before_a_core_that_hangs_has_processed_the_stop(
    bench: Bench,
) -> None:
    bench.drive_on()
    received, answered = threading.Event(), list[SubmitResult]()

    def receive() -> None:
        bench.executive.submit(stop(), answered.append)
        received.set()

    def hang() -> None:
        threading.Thread(target=receive).start()
        assert received.wait(60.0)
        assert bench.rover.velocity == STANDING

    bench.executive.query(hang)
    bench.step()
    assert bench.rover.velocity == STANDING
    assert bench.executive.mode is Mode.STOPPED
    assert isinstance(answered[0], Accepted)


@pytest.mark.parametrize("fails", ["emergency_stop", "pwrite"])
def test_a_stop_acts_though_its_fastest_or_its_durable_path_fails(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    def fail(*_: object) -> None:
        raise OSError(5, "Input/output error")

    bench.drive_on()
    with monkeypatch.context() as broken:
        broken.setattr(os if fails == "pwrite" else bench.rover, fails, fail)
        assert isinstance(bench.submit(Stop(), 2), Accepted)
    assert bench.rover.velocity == STANDING
    bench.step()
    reported = [
        report.text for report in bench.received.reports if "stop is not stored" in report.text
    ]
    assert len(reported) == (fails == "pwrite")
    bench.submit(Resume(), 3)
    bench.execute(MoveForward(0.5), 4)


def test_a_stop_wins_against_a_velocity_that_is_just_being_sent(bench: Bench) -> None:
    bench.drive_on()
    drive: Callable[..., None] = bench.rover.drive
    raced = list[SubmitResult]()

    def race(velocity: Any) -> None:
        if velocity != STANDING and not raced:
            raced.append(Duplicate)  # type: ignore[arg-type]
            bench.executive.submit(stop(), raced.append)
        drive(velocity)

    bench.rover.drive = race  # type: ignore[method-assign]
    bench.step()
    assert raced
    assert bench.rover.velocity == STANDING
    bench.executive.serve_inbox()
    bench.run(1.0)
    assert bench.rover.sent[-20:] == [STANDING] * 20


@pytest.mark.parametrize("identity", [Identity("MOE", 0), Identity("", 5), Identity("a\nb", 5)])
def test_over_the_direct_link_the_answer_reports_that_it_acted(
    aboard: Aboard, identity: Identity
) -> None:
    async def session(client: MrsClient) -> str:
        with pytest.raises(MalError) as raised:
            await client.submit(Command(identity, Stop(), "direct"))
        return describe_error(raised.value)

    message = aboard.ground(session)
    assert message.startswith("Rejected: ")
    assert message.endswith(ALL_THE_SAME)
    assert aboard.do(lambda bench: bench.executive.mode) is Mode.STOPPED


SETTING = '<setTravelSpeed speed="0.5" deadline_s="60"/>'
WIDE = plan(
    '<Parallel success_count="-1"><moveForward distance="50" deadline_s="300"/>'
    f'<Repeat num_cycles="20"><Parallel success_count="-1">{SETTING * 480}</Parallel></Repeat>'
    "</Parallel>"
)


def test_a_plan_commands_a_few_leaves_in_a_tick(tmp_path: Path) -> None:
    with PlanBench(tmp_path) as bench:
        bench.send(Command(Identity("MOE", 1), SubmitPlan(WIDE), "direct"))
        bench.send(Command(Identity("MOE", 2), ActivatePlan("survey"), "direct"))
        before = len(bench.commanded())
        for _ in range(5):
            bench.step()
            now = len(bench.commanded())
            assert now - before <= 8
            before = now
        assert before > 8
        bench.send(stop())
        assert bench.rover.velocity == STANDING
        assert bench.executive.mode is Mode.STOPPED


def _stored(latch: StopLatch) -> OSError | None:
    change = latch.take_change()
    assert change is not None
    return change.store()


@given(text=st.text(min_size=1, max_size=600))
def test_the_latch_reads_its_written_state(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    path = tmp_path_factory.mktemp("latch") / "ledger.stop"
    latch = StopLatch(path)
    latch.set(text)
    assert _stored(latch) is None
    latch.close()
    again = StopLatch(path)
    assert again.stopped_by is not None
    assert text.startswith(again.stopped_by.rstrip("\ufffd?"))
    again.clear()
    assert _stored(again) is None
    again.close()
    last = StopLatch(path)
    last.close()
    assert last.stopped_by is None


@pytest.mark.parametrize("damage", [b"x", b"\0", b"\xff" * 512, b"0" * 600])
def test_a_damaged_latch_counts_as_stopped(tmp_path: Path, damage: bytes) -> None:
    latch = StopLatch(tmp_path / "ledger.stop")
    latch.close()
    with (tmp_path / "ledger.stop").open("r+b") as file:
        file.write(damage)
    latch = StopLatch(tmp_path / "ledger.stop")
    latch.close()
    assert latch.stopped_by is not None


def test_a_latch_that_was_not_synced_is_written_with_the_next_commit(bench: Bench) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fdatasync", _refused)
        bench.submit(Stop(), 7)
        patch.setattr(os, "pwrite", _refused)
        bench.run(0.2)
    bench.submit(Stop(), 8)
    again = StopLatch(bench.folder / "ledger.stop")
    again.close()
    assert again.stopped_by == "MOE:7"


def test_a_stop_that_only_the_ledger_took_is_known_after_kill_9(tmp_path: Path) -> None:
    with Bench(tmp_path) as bench:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "pwrite", _refused)
            assert isinstance(bench.send(stop()), Accepted)
        bench.crash()
        assert bench.executive.mode is Mode.STOPPED
        assert isinstance(bench.submit(Resume(), 8), Accepted)
        bench.crash()
        assert bench.executive.mode in {Mode.IDLE}


def _refused(*_: object) -> int:
    raise OSError(errno.EIO, os.strerror(errno.EIO))


FILL_AND_STOP = """
import sys, time
from pathlib import Path
from executive.commands import Stop
from executive.values.geometry import STANDING
from tests.support.requested_authority import RequestedAuthority
from tests.support.kinematic import Bench

folder = Path(sys.argv[1])
bench = Bench(folder)
bench.drive_on()
with (folder / "filler").open("wb", buffering=0) as filler:
    for size in (4096, 1):
        try:
            while filler.write(b"x" * size):
                pass
        except OSError:
            pass
answer = bench.submit(Stop(), 2)
print(type(answer).__name__, answer.refusal.reason.name, bench.rover.velocity == STANDING)
sys.stdout.flush()
time.sleep(60)
"""


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Give the root of a file system of 1 MiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("only root may mount a file system")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.at_length
def test_a_stop_on_a_disk_that_is_really_full_holds_over_kill_9(small_disk: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", FILL_AND_STOP, str(small_disk)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().split() == ["Rejected", "LEDGER_FAILED", "True"]
        process.send_signal(signal.SIGKILL)
    (small_disk / "filler").unlink()
    with Bench(small_disk) as bench:
        assert bench.executive.mode is Mode.STOPPED
        assert "MOE:2" in bench.executive.why
