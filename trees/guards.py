"""What comes before any work: the priority stop, and safety."""

from py_trees.common import Status

from executive.geometry import STANDING
from executive.reasons import Figure, Reason, Refusal
from trees.leaf import Condition, Leaf

STOP_DEADLINE_S = 5.0


class Stopping(Condition):
    """Whether a stop command is under way."""

    def holds(self) -> bool:
        """Look at the latches."""
        return bool(self.context.latches.stopping)


class Unsafe(Condition):
    """Whether a hazard holds the rover and odometry still shows it moving."""

    def holds(self) -> bool:
        """Look at the latches and the odometry."""
        status = self.context.status
        hazardous = self.context.latches.hazard is not None
        return hazardous and status.odometry_fresh and not status.standing


class Stop(Leaf):
    """Stands; ends the stop commands once odometry says that the rover does."""

    def begin(self) -> float:
        """Allow the time of a stop from full speed."""
        self._began_s = self.context.clock.now_s()
        return STOP_DEADLINE_S

    def act(self) -> Status:
        """Want to stand until the rover does."""
        self.context.intents.motion = STANDING
        if not self.context.status.standing:
            return Status.RUNNING
        took_s = self.context.clock.now_s() - self._began_s
        stopping, self.context.latches.stopping = self.context.latches.stopping, []
        for life in stopping:
            life.execute(
                f"the rover stands after {took_s:.2f} s", (Figure("duration", took_s, "s"),)
            )
        return Status.SUCCESS

    def give_up(self) -> Status:
        """Fail the stop commands: zero was sent, but nothing says that the rover stands."""
        stopping, self.context.latches.stopping = self.context.latches.stopping, []
        for life in stopping:
            life.fail(
                Refusal(
                    Reason.STOP_DEADLINE,
                    f"zero was sent, but odometry did not show the rover standing within"
                    f" {STOP_DEADLINE_S:.0f} s",
                    (Figure("bound", STOP_DEADLINE_S, "s"),),
                )
            )
        return Status.FAILURE


class Hold(Leaf):
    """Stands while a hazard lasts."""

    def begin(self) -> float:
        """Allow the time of a stop from full speed."""
        return STOP_DEADLINE_S

    def act(self) -> Status:
        """Want to stand."""
        self.context.intents.motion = STANDING
        return Status.RUNNING

    def give_up(self) -> Status:
        """Leave it to the latch, which holds on: the camera may work again."""
        return Status.FAILURE
