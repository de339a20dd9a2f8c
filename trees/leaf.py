"""Base classes of the tree's leaves: a deadline on the core's clock, containment of exceptions.

Any exception within a leaf leaves the tree as a `LeafError` with the leaf's path.
The sources of motion confirm standstill for leaves at a stop and at the end of a motion.
"""

from abc import abstractmethod
from collections.abc import Callable
from types import UnionType
from typing import Final

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from executive.goals import Context, Goal, GoalQueue
from executive.plans import LeafError
from executive.state import SourceMotion
from executive.values.facts import Source
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import Identity
from trees.composites import TickedNode


def path_of(behaviour: Behaviour) -> str:
    """Return the stable path of a node: names from the root, joined by slashes."""
    names = [behaviour.name]
    while behaviour.parent is not None:
        behaviour = behaviour.parent
        names.append(behaviour.name)
    return "/".join(reversed(names))


class ContainedNode(TickedNode):
    """A node without children; its exceptions leave the tree with its path."""

    def run(self, ticked: list[Behaviour]) -> Status:
        """Start the node unless it is RUNNING, update it, and stop it once it has ended.

        Raises:
            LeafError: the node raised.
        """
        try:
            if self.status is not Status.RUNNING:
                self.initialise()
            status = self.update()
            if status is not Status.RUNNING:
                self.stop(status)
        except Exception as error:
            raise LeafError(path_of(self)) from error
        self.status = status
        ticked.append(self)
        return status

    @abstractmethod
    def update(self) -> Status:
        """Do the work of one tick."""


class Condition(ContainedNode):
    """A leaf that tests a condition: it never acts and is never RUNNING.

    Its message names the last command that met the condition.

    Args:
        holds: returns whether the condition holds.
        identity_of: returns the command that meets it; None if it concerns no command.
    """

    def __init__(
        self,
        name: str,
        holds: Callable[[], bool],
        identity_of: Callable[[], Identity] | None = None,
    ) -> None:
        super().__init__(name)
        self._holds = holds
        self._identity_of = identity_of

    def update(self) -> Status:
        """Return SUCCESS if the condition holds, otherwise FAILURE."""
        if not self._holds():
            return Status.FAILURE
        if self._identity_of is not None:
            self.feedback_message = str(self._identity_of())
        return Status.SUCCESS


class Leaf(ContainedNode):
    """A primitive. It requests actuator motion through intents and never publishes.

    Attributes:
        timeout_s: its timeout in seconds.
        deadline_s: time of its timeout, on the core's clock.
    """

    def __init__(self, name: str, context: Context) -> None:
        super().__init__(name)
        self.context = context
        self.timeout_s = self.deadline_s = 0.0

    def set_deadline(self, allowed_s: float) -> None:
        """Set the deadline this many seconds from now."""
        self.timeout_s = allowed_s
        self.deadline_s = self.context.clock.now_s() + allowed_s

    def initialise(self) -> None:
        """Start, and set the deadline."""
        self.set_deadline(self.begin())

    def update(self) -> Status:
        """Act; after the deadline, time out."""
        status = self.act()
        late = self.context.clock.now_s() > self.deadline_s
        return self.on_timeout() if late and status is Status.RUNNING else status

    @abstractmethod
    def begin(self) -> float:
        """Prepare, and return the timeout in seconds."""

    @abstractmethod
    def act(self) -> Status:
        """Do the work of one tick."""

    @abstractmethod
    def on_timeout(self) -> Status:
        """Handle the timeout, and return the leaf's status."""


class GoalLeaf(Leaf):
    """A primitive that executes the active goal of a queue, and no other.

    Attributes:
        goal: the goal that was active when the leaf started.
        timeout_text: text of the failure on timeout, before the seconds allowed.
        needs: source of the data that it waits for.
    """

    goal: Goal
    timeout_reason: Reason
    timeout_text: str
    needs: Source | None = None

    def __init__(self, name: str, context: Context, queue: GoalQueue) -> None:
        super().__init__(name, context)
        self.queue = queue

    def initialise(self) -> None:
        """Start on the active goal."""
        if self.queue.active is not None:
            self.goal = self.queue.active
        super().initialise()

    def update(self) -> Status:
        """Act on the goal; fail once it has ended or was replaced."""
        return super().update() if self.queue.active is self.goal else Status.FAILURE

    def on_timeout(self) -> Status:
        """Fail the goal on timeout."""
        text = f"{self.timeout_text} within {self.timeout_s:.1f} s"
        text = self.context.status.rejections.explain(text, self.needs)
        return self.fail(
            Refusal(self.timeout_reason, text, (Figure("bound", self.timeout_s, "s"),))
        )

    def fail(self, refusal: Refusal) -> Status:
        """Fail the goal."""
        self.queue.fail_active(refusal)
        return Status.FAILURE


class Idle(ContainedNode):
    """A leaf without work."""

    def update(self) -> Status:
        """Succeed without an intent."""
        return Status.SUCCESS


class TakeGoal(ContainedNode):
    """Activates the next goal of a queue for the following leaves of a sequence.

    Its message names the command of the last goal.

    Args:
        requests: request types of the following leaves; other goals are left to the next branch.
        waits: returns whether goals must wait now.
    """

    def __init__(
        self,
        name: str,
        queue: GoalQueue,
        requests: UnionType | type,
        waits: Callable[[], bool] = lambda: False,
    ) -> None:
        super().__init__(name)
        self._queue = queue
        self._requests = requests
        self._waits = waits

    def update(self) -> Status:
        """Return SUCCESS if there is a goal for the following leaves."""
        if self._waits():
            return Status.FAILURE
        goal = self._queue.activate_next()
        if goal is None or not isinstance(goal.command.request, self._requests):
            return Status.FAILURE
        self.feedback_message = str(goal.command.identity)
        return Status.SUCCESS


STOP_DEADLINE_S: Final = 5.0
"""Time for each source to confirm standstill, from a stop or the end of a motion."""
_BY_WHEELS: Final = frozenset({"odometry", "joints", "gyro"})


def sources(context: Context) -> tuple[SourceMotion, ...]:
    """Return the motion of the rover by each source that was ever received."""
    over_ground = context.safety.history.over_ground
    felt = None if over_ground is None else over_ground.motion(context.clock.now_s())
    known = context.status.standstill.by_source()
    return known if felt is None else (*known, felt)


def beside_odometry(context: Context) -> tuple[SourceMotion, ...]:
    """Return the sources that the end of a motion waits for, besides those that verify it."""
    return tuple(
        each
        for each in sources(context)
        if each.source == "accelerometer" or (each.awaited and each.source in _BY_WHEELS)
    )


def unconfirmed(context: Context, found: tuple[SourceMotion, ...]) -> str:
    """Return a text of the sources without confirmed standstill; empty if all confirm it."""
    texts = [str(each) for each in found if not each.is_standing]
    if not _odometry_shows(context):
        texts.insert(0, "no odometry")
    if context.safety.sliding is not None:
        texts.append(context.safety.sliding.refusal.text)
    return "; ".join(texts)


def _odometry_shows(context: Context) -> bool:
    """Return whether odometry is fresh enough for control, and shows standstill."""
    shows = (each.source == "odometry" for each in context.status.standstill.by_source())
    return context.status.odometry_fresh and any(shows)


def awaited(context: Context, found: tuple[SourceMotion, ...]) -> bool:
    """Return whether no source shows motion, but one has not been received yet."""
    sure = _odometry_shows(context) and context.safety.sliding is None
    return sure and all(each.is_standing or each.awaited for each in found)


def refusal(context: Context, found: tuple[SourceMotion, ...], bound_s: float) -> Refusal:
    """Return the refusal for an unconfirmed standstill, with the figures of each source."""
    text = f"standstill not confirmed within {bound_s:.0f} s: "
    text += unconfirmed(context, found)
    figures = (
        Figure("bound", bound_s, "s"),
        *(figure for each in found for figure in each.figures),
    )
    if awaited(context, found):
        return Refusal(Reason.UNVERIFIED, text, figures)
    moving = {each.source for each in found if not each.is_standing}
    if not context.status.odometry_fresh or moving & _BY_WHEELS:
        return Refusal(Reason.STOP_DEADLINE, text, figures)
    over_ground, slid = context.safety.history.over_ground, context.safety.sliding
    if over_ground is not None:
        lost = over_ground.lost_speeds
        text += f"; {', '.join(f'{each.name} {each.value:.2f} m/s' for each in lost)}"
        figures += lost
    reason = Reason.SLIDE_AT_REST if slid is None else slid.refusal.reason
    return Refusal(reason, f"{text}. Check that the rover is stationary before resume", figures)
