"""Which plans have the rover, or wait to go on: what mode and intake need to know of plans."""

from typing import Final

PLAN_LINK: Final = "plan"
"""The link of the commands that a plan gives."""

SOURCE_PREFIX: Final = "plan:"
"""What the sources of plans begin with, and no other source may."""


def source_of(plan_id: str) -> str:
    """Return the source of a plan's commands."""
    return f"{SOURCE_PREFIX}{plan_id}"


class Agenda:
    """Set by the planner alone.

    Attributes:
        executing: the plan that has the rover, if any.
        suspended: the plans that wait to be resumed.
    """

    def __init__(self) -> None:
        """Nothing is planned."""
        self.executing: str | None = None
        self.suspended: tuple[str, ...] = ()
