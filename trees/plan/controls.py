"""The nodes of a plan with several children: sequences, fallbacks, parallels, branches."""

from collections.abc import Sequence
from typing import ClassVar

from executive.plans import CellReference, PlanNode, UnknownValueError, Value, case_matches, text_of
from trees.plan.node import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Answer, PlanBehaviour, PlanRun


class ControlNode(PlanBehaviour):
    """A node with several children; those of fallbacks continue after a failure."""

    def __init__(self, plan: PlanNode, run: PlanRun, nodes: Sequence[PlanBehaviour]) -> None:
        super().__init__(plan, run, nodes)
        self.chooses = "Fallback" in plan.kind.name
        self.continues, self.ends = (FAILURE, SUCCESS) if self.chooses else (SUCCESS, FAILURE)


class OrderedBranch(ControlNode):
    """Runs its children in order, until one ends it: `Sequence`, `Fallback`, and their variants.

    Those with `Async` yield after a child that ended in its first tick. `SequenceWithMemory` does,
    and continues at the child that failed, also after it was halted.

    Attributes:
        current: index of the child that it continues with.
        skipped: number of children skipped.
    """

    memory: ClassVar[tuple[str, ...]] = ("current", "skipped")
    current = skipped = 0

    def __init__(self, plan: PlanNode, run: PlanRun, nodes: Sequence[PlanBehaviour]) -> None:
        super().__init__(plan, run, nodes)
        self._remembers = plan.kind.name == "SequenceWithMemory"
        self._yields = self._remembers or plan.kind.name.startswith("Async")
        self.body = self.nodes

    def run(self) -> Answer:
        """Tick the children from the present one on."""
        if self.status is IDLE:
            self.skipped = 0
        self.status = RUNNING
        count = len(self.body)
        while self.current < count:
            child = self.body[self.current]
            begins = child.status is IDLE
            answer = child.execute()
            if answer is RUNNING:
                return RUNNING
            if answer is self.ends:
                for other in self.nodes[self.current :] if self._remembers else self.nodes:
                    other.reset()
                self.current = self.current if self._remembers else 0
                return answer
            self.current += 1
            if self.chooses and self.current < count:
                cause = self.cause_of(child, answer)
                self.decide(self.current, f"{self.branch_text(self.current)}: {cause}")
            if answer is SKIPPED:
                self.skipped += 1
            elif self._yields and begins and self.current < count:
                self.context.yielded = True
                return RUNNING
        answer = SKIPPED if self.skipped == count else self.continues
        self.reset_children()
        self.current = self.skipped = 0
        return answer

    def on_halt(self) -> None:
        """Begin with the first child next time, except with memory."""
        if not self._remembers:
            super().on_halt()


class ReactiveBranch(ControlNode):
    """`ReactiveSequence`, `ReactiveFallback`: tick their children from the first one each time."""

    def run(self) -> Answer:
        """Tick the children; one that is RUNNING resets all others."""
        self.status = RUNNING
        all_skipped, cause = True, ""
        for index, child in enumerate(self.nodes):
            answer = child.execute()
            if self.chooses and answer is not self.continues and answer is not SKIPPED:
                if index or self._choice is not None:
                    cause = cause or f"{child.name} no longer fails"
                    self.decide(index, f"{self.branch_text(index)}: {cause}")
            elif self.chooses:
                cause = self.cause_of(child, answer)
            if answer is SKIPPED:
                child.reset()
                continue
            all_skipped = False
            if answer is RUNNING:
                for other in self.nodes:
                    if other is not child and other.status is not IDLE:
                        other.reset()
                return RUNNING
            if answer is self.ends:
                self.reset_children()
                return answer
        self.reset_children()
        return SKIPPED if all_skipped else self.continues


class ParallelBranch(PlanBehaviour):
    """`Parallel` ticks its children until enough have ended, `ParallelAll` until all have.

    Attributes:
        ended: a bit for each child that has ended.
        good, bad: numbers of successes and failures.
    """

    memory = ("ended", "good", "bad")
    ended = good = bad = 0
    _why = ""

    def run(self) -> Answer:
        """Tick the children in order until the result is decided."""
        self.status = RUNNING
        ports, skipped, count = self.plan.ports, 0, len(self.nodes)
        needed, allowed = ports.get("success_count"), ports.get("failure_count")
        for index, child in enumerate(self.nodes):
            if not self.ended >> index & 1:
                answer = child.execute()
                if answer is SKIPPED:
                    skipped += 1
                elif answer is not RUNNING:
                    self.ended |= 1 << index
                    self.good += answer is SUCCESS
                    self.bad += answer is FAILURE
                    if answer is FAILURE:
                        self._why = self.context.port.why
            if isinstance(needed, int):
                if self.good + (skipped if ports["counts_skipped"] else 0) >= needed:
                    return self._end(SUCCESS)
                if count - self.bad < needed or self.bad == allowed:
                    return self._end(FAILURE)
        if skipped == count:
            return SKIPPED
        if needed is not None or skipped + self.ended.bit_count() < count:
            return RUNNING
        return self._end(FAILURE if self.bad >= self.plan.number("max_failures") else SUCCESS)

    def on_load(self) -> None:
        """Continue with the failure of a child that has ended."""
        super().on_load()
        if (records := self.context.records) is not None:
            failed = (each for each in self.nodes if each.status is FAILURE)
            self._why = next((records.cause(each.plan) for each in failed), "")

    def _end(self, answer: Answer) -> Answer:
        if answer is FAILURE and self._why:  # others have continued, and may have noted theirs
            self.context.port.why = self._why
        self._why = ""
        self.on_halt()
        self.reset_children()
        return answer


class ConditionalBranch(PlanBehaviour):
    """`IfThenElse`: tests its first child once, then runs the second or third one.

    Attributes:
        current: the branch that runs; 0 before the condition has ended.
    """

    memory: ClassVar[tuple[str, ...]] = ("current",)
    current = 0

    def run(self) -> Answer:
        """Tick the condition if it is to be tested, then the branch that it selects."""
        self.status = RUNNING
        if self.current == 0 or not self.memory:
            answer = self.nodes[0].execute()
            if answer is RUNNING:
                return RUNNING
            selected = 0 if answer is SKIPPED else 1 if answer is SUCCESS else 2
            if not 0 < selected < len(self.nodes):
                self.reset_children()
                self.current = 0
                return answer
            for other in self.nodes[1:]:
                if other is not self.nodes[selected]:
                    other.reset()
            self.current = selected
            if selected != self._choice:
                text = f"took {self.nodes[selected].name}: {self.cause_of(self.nodes[0], answer)}"
                self.decide(selected, text)
        answer = self.nodes[self.current].execute()
        if answer is not RUNNING:
            self.reset_children()
            self.current = 0
        return answer


class RepeatedBranch(ConditionalBranch):
    """`WhileDoElse`: tests its first child in each tick, and has no state of its own."""

    memory = ()


class Switch(PlanBehaviour):
    """`Switch2` to `Switch6`: runs the child with the case of the variable, or the last one.

    Attributes:
        running: the child that is RUNNING; -1 for none.
    """

    memory = ("running",)
    running = -1

    def run(self) -> Answer:
        """Select a child, reset another one that runs, tick the selected one."""
        try:
            selected = self._selected()
        except UnknownValueError as unknown:
            self.note_unknown(unknown)
            self.reset_children()
            self.running = -1
            return FAILURE
        if selected != self._choice:
            self.decide(selected, self._selected_text(selected))
        if self.running not in {-1, selected}:
            self.nodes[self.running].reset()
        answer = self.nodes[selected].execute()
        if answer is RUNNING:
            self.running = selected
            return RUNNING
        if answer is not SKIPPED:
            self.reset_children()
        self.running = -1
        return answer

    def _selected_text(self, selected: int) -> str:
        is_default = selected == len(self.nodes) - 1
        case = "default" if is_default else f"case {selected + 1}"
        variable = self.plan.ports.get("variable")
        name, value = "it", variable
        if isinstance(variable, CellReference):
            name, value = variable.name, self.context.cells[variable.cell]
        text = text_of(value) if isinstance(value, float | int | str) else "not written"
        return f"took the {case} {self.nodes[selected].name}: {name} is {text}"

    def _selected(self) -> int:
        last = len(self.nodes) - 1
        try:
            variable = self.read("variable") if "variable" in self.plan.ports else None
        except UnknownValueError as unknown:
            if unknown.cell in self.context.measured:
                raise
            return last
        if variable is None:
            return last
        return next((at for at in range(last) if self._is_case(at, variable)), last)

    def _is_case(self, at: int, variable: Value) -> bool:
        try:
            return case_matches(variable, self.read(f"case_{at + 1}"))
        except UnknownValueError:
            return False


class TryCatch(OrderedBranch):
    """`TryCatch`: a sequence; its last child cleans up after a failure of the others.

    Attributes:
        catching: whether the last child runs.
    """

    memory = (*OrderedBranch.memory, "catching")
    catching = False
    _why = ""

    def __init__(self, plan: PlanNode, run: PlanRun, nodes: Sequence[PlanBehaviour]) -> None:
        super().__init__(plan, run, nodes)
        self.body = self.nodes[:-1]

    def run(self) -> Answer:
        """Tick the children, or the one that cleans up."""
        if self.status is IDLE:
            self.catching = False
        if not self.catching:
            answer = super().run()
            if answer is not FAILURE:
                return answer
            text = f"took the cleanup {self.nodes[-1].name}: {self.cause_of(self, answer)}"
            self.decide("catch", text)
            self.catching, self._why = True, self.context.port.why
            if (records := self.context.records) is not None:
                records.note_cause(self.plan, self._why)
        if self.nodes[-1].execute() is RUNNING:
            return RUNNING
        self.reset_children()
        self.catching = False
        self.context.port.why = self._why or self.context.port.why
        return FAILURE

    def on_load(self) -> None:
        """Continue; a cleanup does not change why the others failed."""
        super().on_load()
        if self.catching and (records := self.context.records) is not None:
            self._why = records.cause(self.plan)

    def on_halt(self) -> None:
        """Let the last child run for one tick, if the plan wants it."""
        if self.plan.ports["catch_on_halt"] and not self.catching:
            for child in self.nodes[:-1]:
                child.reset()
            if self.nodes[-1].execute() is RUNNING:
                self.nodes[-1].reset()
        super().on_halt()
