"""What only a resume ends holds the rover over kill -9, a crash and a restart."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from executive.commands import Mode, MoveForward, MoveTo, Resume, Waypoint
from executive.commands.lifecycle import Accepted
from executive.faults import DECLARED, ClearPolicy, FaultResponse, MonitoredWhen, Reaction, Window
from executive.safety import MONITORS, Evidence, MotionHistory
from executive.settings import (
    LinkLossAction,
    LinkLossSettings,
    LinkLossStage,
    Settings,
    load_settings,
)
from executive.values.geometry import STANDING
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Stage
from tests.support.kinematic import Bench, with_figures
from tests.support.self_moving import SelfMovingRover

pytestmark = pytest.mark.alike

MODES = {Reaction.PAUSE: Mode.PAUSED, Reaction.STOP: Mode.STOPPED, Reaction.SAFE: Mode.SAFE}
LATCHED = [name for name, each in DECLARED.items() if each.row.clears is ClearPolicy.ON_RESUME]
ENDED = [name for name, each in DECLARED.items() if each.row.clears is ClearPolicy.AUTO]
OF_WHOLE_MOTIONS = ("steady_off_command", "steady_turn_off_command")
DANGERS = (Reason.CORE_HUNG, Reason.ADAPTER_RAISED)
Make = Callable[..., Bench]


class Cause:
    """A monitor that sees what a test says."""

    def __init__(self) -> None:
        self.there = False

    def __call__(self, _: MotionHistory, __: Window, ___: float) -> Evidence | None:
        return Evidence("the cause is there", (Figure("seen", 2.5, "m"),)) if self.there else None


@pytest.fixture
def cause() -> Cause:
    return Cause()


def watching(asset: str, name: str, row: FaultResponse) -> Settings:
    """Return settings of an asset that watches for one fault all the time, and for no other."""
    settings = load_settings(asset)
    rows = {each: replace(known.row, reaction=Reaction.IGNORE) for each, known in DECLARED.items()}
    rows[name] = with_figures(replace(row, when=MonitoredWhen.ALWAYS), for_s=0.0)
    return replace(settings, faults=replace(settings.faults, **rows))


def bench_of(folder: Path, name: str, row: FaultResponse) -> Bench:
    """Return a bench whose rover watches for a fault; of the kind for which that is watched."""
    if name in OF_WHOLE_MOTIONS:
        return Bench(folder, watching("mocup", name, row), rover=SelfMovingRover())
    return Bench(folder, watching("jackal", name, row))


def is_in(bench: Bench, mode: Mode) -> bool:
    return bench.executive.mode is mode


def begin(bench: Bench, cause: Cause) -> None:
    """Let the cause of a fault show for two ticks."""
    cause.there = True
    bench.run(0.1)
    cause.there = False


@pytest.mark.at_length
@pytest.mark.parametrize("name", LATCHED)
def test_each_fault_that_a_resume_ends_holds_over_kill_9(
    name: str, tmp_path: Path, cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MONITORS, name, cause)
    row = DECLARED[name].row
    with bench_of(tmp_path, name, row) as bench:
        begin(bench, cause)
        (fault,) = bench.executive.safety.active
        why = bench.executive.why
        for _ in range(2):
            bench.crash()
            assert is_in(bench, MODES[row.reaction])
            bench.run(1.0)
        assert is_in(bench, MODES[row.reaction])
        assert bench.executive.why == why
        (restored,) = bench.executive.safety.active
        assert str(restored) == str(fault)
        assert restored.refusal == fault.refusal
        assert (restored.begun_utc_s, restored.row) == (fault.begun_utc_s, fault.row)
        if row.reaction is Reaction.PAUSE:
            bench.submit(MoveForward(1.0), 1)
            bench.run(1.0)
            assert bench.stages(1) == [Stage.RECEIVED, Stage.ACCEPTED]
            assert bench.executive.velocity == STANDING
        else:
            assert bench.refusal(MoveForward(1.0), 1).reason is Reason.WRONG_MODE
        cause.there = True
        assert bench.refusal(Resume(), 2).reason is Reason.CAUSE_PERSISTS
        cause.there = False
        assert isinstance(bench.submit(Resume(), 3), Accepted)
        assert bench.executive.safety.active == []
        assert f"{name} cleared" in [each.text for each in bench.received.reports]
        bench.crash()
        assert is_in(bench, Mode.IDLE)
        assert bench.executive.safety.active == []


@pytest.mark.at_length
@pytest.mark.parametrize("name", ENDED)
def test_what_ends_by_itself_is_looked_for_afresh(
    name: str, tmp_path: Path, cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MONITORS, name, cause)
    with bench_of(tmp_path, name, DECLARED[name].row) as bench:
        begin(bench, cause)
        assert [each.name for each in bench.executive.safety.active] == [name]
        bench.crash()
        assert is_in(bench, Mode.IDLE)
        assert bench.executive.safety.active == []


@pytest.mark.at_length
@pytest.mark.parametrize("then", [Reaction.WARN, Reaction.SLOW_DOWN, *MODES])
def test_an_asset_that_has_a_fault_end_by_a_resume_has_it_after_a_restart(
    then: Reaction, tmp_path: Path, cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MONITORS, "slide_at_rest", cause)
    row = replace(DECLARED["slide_at_rest"].row, reaction=then, clears=ClearPolicy.ON_RESUME)
    with Bench(tmp_path, watching("jackal", "slide_at_rest", row)) as bench:
        begin(bench, cause)
        slow_ratio = bench.executive.status.speed_limit_ratio
        bench.crash()
        assert is_in(bench, MODES.get(then, Mode.IDLE))
        assert [each.name for each in bench.executive.safety.active] == ["slide_at_rest"]
        assert bench.executive.status.speed_limit_ratio == slow_ratio
        assert (slow_ratio < 1.0) is (then is Reaction.SLOW_DOWN)


def test_a_fault_that_the_file_no_longer_watches_for_ends_by_a_resume_alone(
    tmp_path: Path, cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(MONITORS, "tilt_limit", cause)
    with Bench(tmp_path, watching("jackal", "tilt_limit", DECLARED["tilt_limit"].row)) as bench:
        begin(bench, cause)
        cause.there = True
        bench.settings = watching("jackal", "slide_at_rest", DECLARED["slide_at_rest"].row)
        bench.crash()
        bench.run(0.5)
        assert is_in(bench, Mode.SAFE)
        assert isinstance(bench.submit(Resume(), 1), Accepted)
        assert is_in(bench, Mode.IDLE)


@pytest.mark.parametrize("reason", DANGERS)
def test_what_is_made_safe_beside_the_table_is_safe_after_kill_9(
    reason: Reason, bench: Bench
) -> None:
    bench.drive_on()
    bench.executive.enter_safe_mode(
        Refusal(reason, "it hung for 2.0 s", (Figure("silent", 2.0, "s"),))
    )
    bench.step()
    bench.crash()
    bench.run(0.5)
    assert is_in(bench, Mode.SAFE)
    assert bench.executive.why.endswith(
        "SAFE: it hung for 2.0 s; the cause is cleared: send resume"
    )
    assert [each.name for each in bench.executive.safety.active] == [reason.name.lower()]
    bench.submit(Resume(), 2)
    bench.crash()
    bench.run(0.1)
    bench.execute(MoveForward(0.5), 3)


@pytest.mark.parametrize("mended_before", [False, True])
def test_a_ledger_that_failed_is_safe_after_kill_9(mended_before: bool, bench: Bench) -> None:
    bench.drive_on()
    bench.fill_disk()
    bench.submit(MoveForward(1.0), 2)
    bench.run(0.2)
    assert is_in(bench, Mode.SAFE)
    if mended_before:
        bench.fill_disk(False)
        bench.run(0.1)
    for _ in range(2):
        bench.crash()
        bench.run(0.2)
        assert is_in(bench, Mode.SAFE)
        assert "the ledger" in bench.executive.why or "ledger /" in bench.executive.why
    bench.submit(Resume(), 3)
    bench.crash()
    bench.run(0.1)
    assert is_in(bench, Mode.IDLE)


def test_a_lost_link_stops_until_a_resume_over_kill_9(tmp_path: Path) -> None:
    stages = (LinkLossStage(2.0, LinkLossAction.STOP),)
    settings = replace(load_settings("jackal"), link_loss=LinkLossSettings(motion=stages))
    with Bench(tmp_path, settings) as bench:
        bench.submit(MoveTo(Waypoint(5.0, 0.0)), 1)
        bench.run(3.0)
        assert is_in(bench, Mode.STOPPED)
        bench.crash()
        bench.run(0.5)
        assert is_in(bench, Mode.STOPPED)
        assert "no contact with the ground" in bench.executive.why
        bench.submit(Resume(), 2)
        assert is_in(bench, Mode.IDLE)


def test_what_ends_by_itself_does_not_end_what_a_resume_ends(
    tmp_path: Path, cause: Cause, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread hung while the rover slipped; the slip was over first."""
    monkeypatch.setitem(MONITORS, "travel_slip", cause)
    with Bench(tmp_path, watching("jackal", "travel_slip", DECLARED["travel_slip"].row)) as bench:
        begin(bench, cause)
        bench.executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung"))
        assert is_in(bench, Mode.SAFE)
        bench.run(2.0)
        assert is_in(bench, Mode.SAFE)
        assert [each.name for each in bench.executive.safety.active] == ["core_hung"]


def test_what_was_not_reported_is_not_latched_and_what_was_is(bench: Bench) -> None:
    """The report of a fault and its latch are one commit."""
    bench.drive_on()
    bench.executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung"))
    bench.crash()
    assert is_in(bench, Mode.IDLE)
    assert all(each.text != "it hung" for each in bench.executive.reports())
    bench.executive.enter_safe_mode(Refusal(Reason.CORE_HUNG, "it hung"))
    bench.executive.serve_inbox()
    bench.crash()
    assert is_in(bench, Mode.SAFE)
    assert any(each.text == "it hung" for each in bench.executive.reports())
