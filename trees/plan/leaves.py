"""The leaves of a plan that BehaviorTree.CPP has, and the leaf that gives a command."""

from abc import abstractmethod

from executive.plans import LeafError, PlanStep
from trees.plan.node import FAILURE, IDLE, RUNNING, SUCCESS, Answer, PlanBehaviour, time_text


class PlanLeaf(PlanBehaviour):
    """A leaf; its exceptions leave the tree with its path."""

    def execute(self) -> Answer:
        """Tick the leaf; see `PlanBehaviour.execute`."""
        try:
            return super().execute()
        except LeafError:
            raise
        except Exception as error:
            raise LeafError(self.plan.location.path) from error


class FixedResult(PlanLeaf):
    """`AlwaysSuccess`, `AlwaysFailure`."""

    def run(self) -> Answer:
        """Return the result."""
        if self.plan.kind.name == "AlwaysSuccess":
            return SUCCESS
        self.context.port.note_failure(self.plan, "fails always")
        return FAILURE


class ScriptAction(PlanLeaf):
    """`Script`: runs statements."""

    def run(self) -> Answer:
        """Run them; fail if a value is not known."""
        return FAILURE if self.holds(self.script("code")) is None else SUCCESS


class ScriptCondition(PlanLeaf):
    """`ScriptCondition`: tests a condition in each tick."""

    def run(self) -> Answer:
        """Test it; fail if a value is not known."""
        holds = self.holds(self.script("code"))
        if holds is not None:
            self.feedback_message = ""
        if holds is False:
            self.context.port.note_failure(self.plan, f"not {self.script('code').text}")
        return SUCCESS if holds else FAILURE


class SetBlackboard(PlanLeaf):
    """`SetBlackboard`: sets a variable."""

    def run(self) -> Answer:
        """Set it; fail if the other variable has no known value."""
        self.write("output_key", self.read("value"))
        return SUCCESS


class TimedLeaf(PlanLeaf):
    """A leaf that is begun once, and continues until it ends."""

    def run(self) -> Answer:
        """Begin, or continue; an end stays until the leaf is reset."""
        if self.status is IDLE:
            return self.begin()
        return self.proceed() if self.status is RUNNING else self.status

    def begin(self) -> Answer:
        """Do the work of the first tick; by default that of each."""
        return self.proceed()

    @abstractmethod
    def proceed(self) -> Answer:
        """Do the work of the other ticks."""


class Sleep(TimedLeaf):
    """`Sleep`: waits on the executive's clock.

    Attributes:
        until_s: end of the wait.
    """

    timers = ("until_s",)
    until_s: float | None = None

    def begin(self) -> Answer:
        """Start the timer."""
        self.until_s = self.context.port.clock.now_s() + self.plan.number("msec") / 1000
        return RUNNING

    def proceed(self) -> Answer:
        """Succeed at the end of the wait."""
        if self.until_s is not None and self.overdue_s(self.until_s) < 0.0:
            return RUNNING
        self.until_s = None
        return SUCCESS

    @property
    def next_utc_s(self) -> float | None:
        """The end of the wait."""
        return self.utc_of(self.until_s)

    @property
    def waits(self) -> str:
        """The end of the wait."""
        until_utc_s = self.next_utc_s
        return "" if until_utc_s is None else f"waits until {time_text(until_utc_s)}"


class CommandLeaf(TimedLeaf):
    """Gives a command, and waits up to its deadline for its end; its message names the command.

    Attributes:
        deadline_s: end of the time for the command, on the executive's clock; None when the command
            is to be given.
    """

    deadline_s: float | None = None

    @property
    def next_utc_s(self) -> float | None:
        """The deadline."""
        return self.utc_of(self.deadline_s)

    @property
    def step(self) -> PlanStep:
        """The command."""
        assert isinstance(self.plan, PlanStep)
        return self.plan

    def proceed(self) -> Answer:
        """Request the command if it is to be given, and poll it."""
        step, port = self.step, self.context.port
        now_s = port.clock.now_s()
        if self.deadline_s is None:
            port.request(step, self.cycles, self.context.cells)
            allowed_s = step.deadline_s
            self.deadline_s = float("inf") if allowed_s is None else now_s + allowed_s
        outcome = port.poll(step)
        if outcome is None and now_s >= self.deadline_s:
            assert step.deadline_s is not None
            outcome = port.fail_overdue(step, step.deadline_s)
        self.feedback_message = port.command_text(step)
        if outcome is None:
            return RUNNING
        self.deadline_s = None
        self.write("reason", outcome.reason)
        self.write("file", outcome.file or None)
        return SUCCESS if outcome.succeeded else FAILURE

    def on_halt(self) -> None:
        """Cancel the command."""
        self.deadline_s = None
        self.context.port.halt_step(self.step)

    def on_load(self) -> None:
        """Show the last command; the deadline starts again."""
        super().on_load()
        self.deadline_s = None
        self.feedback_message = self.context.port.command_text(self.step)
