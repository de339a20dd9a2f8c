from executive.commands.catalogue import MoveForward, Resume, Stop
from executive.commands.lifecycle import Refused, Repeated
from executive.commands.modes import Mode
from executive.geometry import STANDING
from executive.reasons import Reason
from executive.reports import Stage
from tests.support.kinematic import Bench


def test_a_repeat_is_answered_with_the_last_report_and_not_executed(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    bench.finish(1)
    place = bench.rover.pose
    last = bench.last(1)
    answer = bench.submit(MoveForward(1.0), 1)
    assert answer == Repeated(last)
    assert bench.heard.reports[-1] == last
    bench.run(3.0)
    assert bench.rover.pose == place


def test_a_number_used_for_something_else_is_refused(bench: Bench) -> None:
    bench.submit(MoveForward(1.0), 1)
    answer = bench.submit(MoveForward(2.0), 1)
    assert isinstance(answer, Refused)
    assert answer.refusal.reason is Reason.DUPLICATE
    assert bench.finish(1) is Stage.EXECUTED


def test_a_repeated_stop_does_not_stop_what_was_resumed(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.finish(1)
    bench.submit(Resume(), 2)
    bench.submit(MoveForward(3.0), 3)
    bench.run(1.0)
    assert isinstance(bench.submit(Stop(), 1), Repeated)
    assert bench.executive.mode is Mode.MOVING
    assert bench.finish(3) is Stage.EXECUTED


def test_a_stop_holds_over_a_crash(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.run(1.0)
    bench.submit(Stop(), 2)
    bench.crash()
    bench.run(0.1)
    assert bench.executive.mode is Mode.STOPPED
    assert "MOE:2" in bench.executive.why
    assert isinstance(bench.submit(MoveForward(1.0), 3), Refused)


def test_a_resume_holds_over_a_crash(bench: Bench) -> None:
    bench.submit(Stop(), 1)
    bench.submit(Resume(), 2)
    bench.crash()
    bench.run(0.1)
    assert bench.executive.mode is Mode.IDLE


def test_a_flood_does_not_keep_the_rover_from_its_ticks(bench: Bench) -> None:
    asked: list[int] = []

    def ask_again() -> None:
        asked.append(len(asked))
        if len(asked) < 1000:
            bench.executive.ask(ask_again)

    bench.executive.ask(ask_again)
    bench.step()
    bench.step()
    assert len(asked) == 2


def test_a_command_expires_in_the_queue(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2, lifetime_s=2.0)
    bench.finish(1)
    assert bench.finish(2) is Stage.EXPIRED
    assert bench.stages(2) == [Stage.RECEIVED, Stage.ACCEPTED, Stage.EXPIRED]
    assert bench.last(2).reason is Reason.EXPIRED


def test_kill_9_ends_what_was_under_way_and_never_runs_it_again(bench: Bench) -> None:
    bench.submit(MoveForward(5.0), 1)
    bench.submit(MoveForward(1.0), 2)
    bench.run(2.0)
    bench.crash()
    assert bench.rover.velocity == STANDING
    assert bench.stages(1)[-1] is Stage.FAILED
    assert bench.last(1).reason is Reason.INTERRUPTED
    assert bench.stages(2)[-1] is Stage.CANCELLED
    place = bench.rover.pose
    assert isinstance(bench.submit(MoveForward(5.0), 1), Repeated)
    bench.run(3.0)
    assert bench.rover.pose == place
    sequences = [report.sequence for report in bench.heard.reports[:-1]]
    assert sequences == list(range(1, len(sequences) + 1))
