"""How far a motion has come through its steps, and how its next leg is to be planned."""

from dataclasses import dataclass

from executive.obstacles.zones import ClearanceViolation
from executive.values.geometry import Point


@dataclass(slots=True)
class LegProgress:
    """The progress of a goal through its steps, as its leaves note it; a step takes legs.

    Attributes:
        step: index of the step under way.
        attempts: how often the step was ended away from its target.
        detour_stops: how many places the goal has stood at on ways around obstacles.
        obstacle_stops: how often something that came into view has ended a line of the step.
        at_detour: whether the leg ends at a place on a way around, and not at that of the step.
        left_path: whether the step leads around something seen, and not straight to its waypoint.
        turn_then_drive: whether the step is driven by turns and lines, since no curve led there.
        blocking: what came into view last, until the way around it is planned.
        last_driven: where a motion led the rover last, until the next is planned.
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
        """Whether no leg of the step has ended yet, nor one on a way around before."""
        return not self.attempts and not self.detour_stops

    @property
    def new(self) -> bool:
        """Whether no leg of the goal has ended yet."""
        return not self.step and self.untried

    def end_step(self) -> None:
        """Go on with the next step."""
        self.step += 1
        self.attempts = self.obstacle_stops = 0
        self.left_path = self.turn_then_drive = False

    def begin_leg(self, detour: bool, in_one: bool) -> None:
        """Begin a leg.

        Args:
            detour: whether it leads around obstacles.
            in_one: whether it is driven in one curve, without a stop on the way around.
        """
        self.at_detour = detour and not in_one
        self.left_path = self.left_path or detour
        self.blocking = None

    def stop_before(self, blocking: ClearanceViolation | None) -> None:
        """End a leg before something that came into view, which the next leads around."""
        self.blocking = blocking
        self.detour_stops += 1
        self.obstacle_stops += 1

    def end_detour(self) -> None:
        """End a leg at a place on a way around."""
        self.detour_stops += 1
        self.attempts = 0

    def give_up_curve(self, through: bool) -> None:
        """End a curve that leads nowhere: one to a single place is not tried again."""
        self.attempts += 1
        self.turn_then_drive = not through
