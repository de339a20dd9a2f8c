"""The progress of a motion through its steps, which determines how its next leg is planned."""

from dataclasses import dataclass

from executive.obstacles.zones import ClearanceViolation
from executive.values.geometry import Point


@dataclass(slots=True)
class LegProgress:
    """The progress of a goal through its steps, as its leaves record it; a step has legs.

    Attributes:
        step: index of the step in execution.
        attempts: how often the step ended off its target.
        detour_stops: number of stops of the goal on detours around obstacles.
        obstacle_stops: how often a newly detected obstacle ended a line of the step.
        at_detour: whether the leg ends at a detour point, and not at the target of the step.
        left_path: whether the step detours around a scanned obstacle.
        turn_then_drive: whether turns and lines drive the step, since its curve failed.
        blocking: the newly detected obstacle, until the detour around it is planned.
        last_driven: where a motion ended last, until the next is planned.
    """

    step: int = 0
    attempts: int = 0
    detour_stops: int = 0
    obstacle_stops: int = 0
    at_detour: bool = False
    left_path: bool = False
    turn_then_drive: bool = False
    blocking: ClearanceViolation | None = None
    last_driven: Point | None = None

    @property
    def untried(self) -> bool:
        """Whether no leg of the step has ended yet, nor a detour leg before it."""
        return not self.attempts and not self.detour_stops

    @property
    def new(self) -> bool:
        """Whether no leg of the goal has ended yet."""
        return not self.step and self.untried

    def end_step(self) -> None:
        """Continue with the next step."""
        self.step += 1
        self.attempts = self.obstacle_stops = 0
        self.left_path = self.turn_then_drive = False

    def begin_leg(self, detour: bool, in_one: bool) -> None:
        """Begin a leg.

        Args:
            detour: whether it is a detour around obstacles.
            in_one: whether it is driven as one curve, without a stop on the detour.
        """
        self.at_detour = detour and not in_one
        self.left_path = self.left_path or detour
        self.blocking = None

    def stop_before(self, blocking: ClearanceViolation | None) -> None:
        """End a leg before a newly detected obstacle, which the next leg avoids."""
        self.blocking = blocking
        self.detour_stops += 1
        self.obstacle_stops += 1

    def end_detour(self) -> None:
        """End a leg at a detour point."""
        self.detour_stops += 1
        self.attempts = 0

    def abandon_curve(self, through: bool) -> None:
        """Abandon a curve without a solution: one to a single waypoint is not tried again."""
        self.attempts += 1
        self.turn_then_drive = not through
