"""Questions of plans over the relay link: sent until they end, and answered once by any link."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mops import OpenQuestions, fingerprint, messages_in, questions_of
from adapters.relay.rover import executive_link
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from adapters.system import OperatingSystem
from executive.commands import AbortPlan, AnswerQuestion, SuspendPlan
from executive.commands.lifecycle import Accepted
from executive.core.runner import Executive
from executive.values.clock import ManualClock
from executive.values.ports import Downlink
from executive.values.reasons import Reason
from executive.values.reports import Identity, PlanStatus, Stage
from tests.relay.rover.ends import DICTIONARY
from tests.stress.mops_aboard import Wire
from tests.support.plans import PlanBench, plan

PLAN = """<Sequence>
  <Ask name="ditch" question="Cross?" options="cross;back" default="back" deadline_s="60"
    answer="{a}"/>
  <Sleep msec="900000"/>
  <takePicture deadline_s="9"/>
</Sequence>"""


QUESTIONS_S, QUIET_S = 5.0, 20.0


class SystemOfClock(OperatingSystem):
    """A computer with the clock of a bench."""

    def __init__(self, clock: ManualClock) -> None:
        self.now_s, self.utc_s = clock.now_s, clock.utc_s


class QuestionBench(PlanBench):
    """An executive with plans and a relay link, and what stands where rover-relay does."""

    def downlinks(self) -> list[Downlink]:
        self.wire = Wire()
        system = SystemOfClock(self.clock)
        self.link = ExecutiveRelayLink(self.wire, self.ledger, DICTIONARY, "JACKAL", system)
        return [*super().downlinks(), self.link]

    def _start(self) -> Executive:
        executive = super()._start()
        self.link.serve(executive.submit, lambda: executive.mode, executive.plan_questions)
        return executive

    def pass_s(self, duration_s: float) -> list[OpenQuestions]:
        """Let time pass; return the questions that were published."""
        for _ in range(max(1, round(duration_s))):
            self.run(min(duration_s, 1.0))
            self.link.poll()
        texts = [text for text in self.wire.output if "|QUESTIONS|" in text]
        for text in self.wire.output:
            self.link.on_confirmed(fingerprint(text))
        self.wire.output.clear()
        entry = DICTIONARY.spelling.questions
        return [questions_of(each, entry) for text in texts for each in messages_in(text, print)]

    def answer_by_relay(self, option: str, number: int) -> tuple[Stage | None, Reason | None]:
        """Send an answer over the relay; return how its command ends."""
        request = AnswerQuestion("survey", "ditch", option)
        self.link.command(str(DICTIONARY.command(request, Identity("MOE", number), "JACKAL")))
        self.executive.serve_inbox()
        self.run(1.0)
        last = self.ledger.last_report(Identity("MOE", number))
        assert last is not None
        assert not isinstance(last.reason, int)
        return last.stage, last.reason  # type: ignore[return-value]


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[QuestionBench]:
    monkeypatch.setattr(executive_link, "QUESTIONS_S", QUESTIONS_S)
    monkeypatch.setattr(executive_link, "QUIET_S", QUIET_S)
    with QuestionBench(tmp_path) as bench:
        bench.go(plan(PLAN))
        yield bench


def test_a_question_is_repeated_until_it_ends_and_its_end_too(bench: QuestionBench) -> None:
    (first,) = bench.pass_s(2.0)
    ((plan_id, question),) = first.questions
    assert (plan_id, question.key, question.text) == (
        "survey",
        "plan:survey/Sequence/ditch",
        "Cross?",
    )
    assert (question.options, question.default) == (("cross", "back"), "back")
    assert question.until_utc_s is not None
    assert question.until_utc_s - first.utc_s == pytest.approx(60.0, abs=3.0)
    repeats = bench.pass_s(2 * QUESTIONS_S)
    assert [each.questions for each in repeats] == [first.questions] * 2
    bench.request(AnswerQuestion("survey", "ditch", "cross"))
    (end, *ends) = bench.pass_s(3 * QUESTIONS_S)
    assert end.questions == ()
    assert len(ends) == 2
    bench.pass_s(QUIET_S)
    assert bench.pass_s(2 * QUESTIONS_S) == []


def test_a_question_stays_open_over_suspension_and_restart_and_ends_with_its_plan(
    bench: QuestionBench,
) -> None:
    (first,) = bench.pass_s(2.0)
    bench.request(SuspendPlan("survey"))
    assert all(each.questions == first.questions for each in bench.pass_s(QUESTIONS_S))
    bench.crash()
    (again, *_) = bench.pass_s(2.0)
    ((plan_id, question),) = again.questions
    assert (plan_id, question.key, question.options) == (
        "survey",
        "plan:survey/Sequence/ditch",
        ("cross", "back"),
    )
    bench.request(AbortPlan("survey"))
    assert bench.pass_s(2.0)[-1].questions == ()


@pytest.mark.parametrize("first", ["direct", "relay"])
def test_an_answer_counts_once_by_any_link(bench: QuestionBench, first: str) -> None:
    bench.pass_s(2.0)
    if first == "direct":
        assert isinstance(bench.request(AnswerQuestion("survey", "ditch", "cross")), Accepted)
        bench.run(1.0)
        assert bench.answer_by_relay("cross", 7) == (Stage.EXECUTED, None)
        assert bench.answer_by_relay("back", 8) == (Stage.REJECTED, Reason.QUESTION_ANSWERED)
    else:
        assert bench.answer_by_relay("cross", 7) == (Stage.EXECUTED, None)
        assert isinstance(bench.request(AnswerQuestion("survey", "ditch", "cross")), Accepted)
        refused = bench.plan_refusal(AnswerQuestion("survey", "ditch", "back"))
        assert refused.reason is Reason.QUESTION_ANSWERED
        assert bench.answer_by_relay("cross", 7) == (Stage.EXECUTED, None)
    assert bench.status().status is PlanStatus.EXECUTING


def test_an_answer_after_the_default_is_refused(bench: QuestionBench) -> None:
    bench.pass_s(63.0)
    assert bench.answer_by_relay("cross", 7) == (Stage.REJECTED, Reason.QUESTION_ANSWERED)
    assert bench.answer_by_relay("back", 8) == (Stage.EXECUTED, None)
