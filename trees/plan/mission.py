"""The leaves of a plan that are the mission's own: waits, questions, conditions on the rover."""

from math import hypot
from typing import ClassVar

from executive.plans import number, question_of
from executive.values.parameters import Parameter
from executive.values.plan_nodes import Question
from trees.plan.leaves import PlanLeaf, TimedLeaf
from trees.plan.node import FAILURE, RUNNING, SUCCESS, Answer, time_text


class WaitUntil(TimedLeaf):
    """`WaitUntil`: succeeds from a time on; fails if it begins too late."""

    def begin(self) -> Answer:
        """Fail if the time has passed by more than is allowed."""
        utc_s, ports = self.plan.number("utc"), self.plan.ports
        if "late_s" in ports and self.past_s(utc_s + self.plan.number("late_s")) > 0.0:
            text = f"{self.context.port.clock.utc_s() - utc_s:.0f} s after its time"
            self.context.port.note_failure(self.plan, text)
            return FAILURE
        return self.proceed()

    def proceed(self) -> Answer:
        """Succeed from the time on."""
        return RUNNING if self.past_s(self.plan.number("utc")) < 0.0 else SUCCESS

    @property
    def next_utc_s(self) -> float:
        """The time that it waits for."""
        return self.plan.number("utc")

    @property
    def waits(self) -> str:
        """The time that it waits for."""
        return f"waits until {time_text(self.plan.number('utc'))}"


class _WaitingLeaf(TimedLeaf):
    """A leaf with a deadline that continues over suspensions.

    Attributes:
        until_utc_s: the deadline, seconds since 1970-01-01 UTC; None without one.
    """

    memory: ClassVar[tuple[str, ...]] = ("until_utc_s",)
    until_utc_s: float | None = None

    def begin(self) -> Answer:
        """Set the deadline."""
        self.until_utc_s = None
        if "deadline_s" in self.plan.ports:
            allowed_s = self.plan.number("deadline_s")
            self.until_utc_s = self.context.port.clock.utc_s() + allowed_s
        return self.proceed()

    @property
    def next_utc_s(self) -> float | None:
        """The deadline."""
        return self.until_utc_s

    @property
    def deadline(self) -> str:
        """The deadline as text; empty without one."""
        return "" if self.until_utc_s is None else f" until {time_text(self.until_utc_s)}"

    @property
    def is_overdue(self) -> bool:
        """Whether the deadline has passed."""
        return self.until_utc_s is not None and self.past_s(self.until_utc_s) >= 0.0


class WaitFor(_WaitingLeaf):
    """`WaitFor`: succeeds as soon as a condition holds; an unknown condition does not hold."""

    def proceed(self) -> Answer:
        """Test the condition, then the deadline."""
        why, holds = self.context.port.why, self.holds(self.script("if"))
        if holds:
            self.feedback_message = ""
            return SUCCESS
        if holds is False:
            self.feedback_message = ""
        if not self.is_overdue:
            self.context.port.why = why  # it has not failed, though its value is not known
            return RUNNING
        text = self.feedback_message or f"not {self.script('if').text} within its deadline"
        self.context.port.note_failure(self.plan, text)
        return FAILURE

    @property
    def waits(self) -> str:
        """Its condition and deadline."""
        return f"waits for {self.script('if').text}{self.deadline}"


class OperatorQuestion(_WaitingLeaf):
    """A question to the operators; at the deadline the default is the answer."""

    def proceed(self) -> Answer:
        """Take the answer, or the default at the deadline."""
        port = self.context.port
        answer = port.take_answer(self._question)
        if answer is not None:
            self.decide(answer, f"answered {answer}")
        elif self.is_overdue:
            default = self.plan.ports.get("default")
            port.withdraw(self._question, str(default or ""))
            if not isinstance(default, str):
                port.note_failure(self.plan, "no answer within its deadline")
                return FAILURE
            answer = default
            self.decide(answer, f"took the default {answer}: no answer within its deadline")
        if answer is None:
            return RUNNING
        self.write("answer", answer)
        return SUCCESS

    @property
    def _question(self) -> Question:
        return question_of(self.plan, self.until_utc_s)

    @property
    def waits(self) -> str:
        """The question with its options, deadline and default."""
        question = self._question
        default = "" if question.default is None else f", then {question.default}"
        options = " or ".join(question.options)
        text = f"{self.name}: {question.text} ({options}){self.deadline}{default}"
        return f"waits for an answer to {text}"

    def on_halt(self) -> None:
        """Withdraw the question."""
        self.context.port.withdraw(self._question)


class RoverCondition(PlanLeaf):
    """`Near`, `Reachable`, `FaultActive`: a failure has a reason."""

    def run(self) -> Answer:
        """Test the condition."""
        tests = {"Near": self._is_far, "Reachable": self._is_refused, "FaultActive": self._is_well}
        why = tests[self.plan.kind.name]()
        if why:
            self.context.port.note_failure(self.plan, why)
        return FAILURE if why else SUCCESS

    def _is_far(self) -> str:
        x_m, y_m = self._point()
        port = self.context.port
        here = [port.telemetry(each.value) for each in (Parameter.POS_X, Parameter.POS_Y)]
        if None in here:
            return "the position is not known"
        here_x_m, here_y_m = (float(each) for each in here if each is not None)
        distance_m = hypot(x_m - here_x_m, y_m - here_y_m)
        self.feedback_message = f"{distance_m:.2f} m away"
        return "" if distance_m <= self.plan.number("within") else self.feedback_message

    def _is_refused(self) -> str:
        refusal = self.context.port.check_target(*self._point())
        if refusal is None:
            return ""
        self.feedback_message = refusal.text
        return refusal.text

    def _is_well(self) -> str:
        name = self.plan.text("name")
        return "" if self.context.port.fault_active(name) else f"{name} is not active"

    def _point(self) -> tuple[float, float]:
        """Return the coordinates in m.

        Raises:
            ArgumentError: the variable of one has another text than a number.
        """
        x, y = self.read("x"), self.read("y")
        x_m = number("x", x, "m") if isinstance(x, str) else float(x)
        return x_m, number("y", y, "m") if isinstance(y, str) else float(y)
