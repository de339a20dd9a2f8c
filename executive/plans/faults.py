"""What is wrong with a plan, and in which line."""

from executive.reasons import Figure, Reason, Refusal

ARGUMENT = 1
"""Index of the plan among the parts of `submitPlan`."""


class PlanError(Exception):
    """A plan is not valid; never leaves `executive.plans.checking`.

    Attributes:
        refusal: what mission control is told.
    """

    def __init__(self, reason: Reason, line: int | None, text: str) -> None:
        """Name the line first, if it is of one."""
        where = "" if line is None else f"line {line}: "
        figures = () if line is None else (Figure("line", line),)
        self.refusal = Refusal(reason, f"{where}{text}", figures, ARGUMENT)
        super().__init__(self.refusal.text)
