"""Which plans have the rover, or wait to go on: what mode and intake need to know of plans."""


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
