"""Goals: what accepted commands ask of the tree, and the context that its leaves share."""

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from executive.clock import Clock
from executive.commands import CameraWork, Command, DriveFor, FollowPath, InstantCommand, Motion
from executive.commands.intake import expired
from executive.commands.lifecycle import Life
from executive.motion import Intents, Latches, Locomotion
from executive.plans import ActivePlans
from executive.ports import Video
from executive.reasons import Figure, Refusal
from executive.settings import Settings
from executive.state import FileFolder, Status


class Goal:
    """One accepted command, and how far it has come.

    Attributes:
        step: index of the step under way, of `step_count`.
        attempts: how often the step was ended away from its target.
    """

    def __init__(self, life: Life, arrived_utc_s: float) -> None:
        self.life = life
        self.arrived_utc_s = arrived_utc_s
        self.started_s = 0.0
        self.step = 0
        self.attempts = 0

    @property
    def command(self) -> Command:
        """The command that asked for it."""
        return self.life.command

    @property
    def step_count(self) -> int:
        """How many steps it has: the waypoints of a path, else one."""
        request = self.command.request
        return len(request.waypoints) if isinstance(request, FollowPath) else 1

    @property
    def is_velocity(self) -> bool:
        """Whether it holds a velocity instead of going somewhere."""
        return isinstance(self.command.request, DriveFor)


class GoalQueue:
    """Goals of one branch of the tree, in the order of their arrival; at most one is active."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: deque[Goal] = deque()
        self.active: Goal | None = None

    @property
    def waiting(self) -> int:
        """How many goals wait, without the active one."""
        return len(self._waiting)

    def __len__(self) -> int:
        return len(self._waiting) + (self.active is not None)

    def add(self, life: Life) -> None:
        """Put an accepted command's goal at the end."""
        self._waiting.append(Goal(life, self._clock.utc_s()))

    def take(self) -> Goal | None:
        """Return the active goal, else start the next one whose lifetime is not over."""
        while self.active is None and self._waiting:
            goal = self._waiting.popleft()
            late = expired(goal.command, self._clock.utc_s(), goal.arrived_utc_s)
            if late:
                goal.life.expire(late)
            else:
                goal.started_s = self._clock.now_s()
                self.active = goal
                goal.life.start()
        return self.active

    def execute(self, text: str = "", figures: tuple[Figure, ...] = ()) -> None:
        """End the active goal with success."""
        self._end(lambda goal: goal.life.execute(text, figures))

    def fail(self, refusal: Refusal) -> None:
        """End the active goal without success."""
        self._end(lambda goal: goal.life.fail(refusal))

    def cancel(self, life: Life, refusal: Refusal) -> None:
        """End one goal, waiting or active, as cancelled; nothing, if it is not here."""
        if self.active is not None and self.active.life is life:
            self._end(lambda goal: goal.life.cancel(refusal))
            return
        for goal in self._waiting:
            if goal.life is life:
                self._waiting.remove(goal)
                life.cancel(refusal)
                return

    def cancel_all(self, refusal: Refusal) -> None:
        """End the active goal and all that wait, as cancelled."""
        self._end(lambda goal: goal.life.cancel(refusal))
        while self._waiting:
            self._waiting.popleft().life.cancel(refusal)

    def fail_all(self, refusal: Refusal) -> None:
        """End the active goal as failed, and cancel all that wait, for the same reason."""
        self.fail(refusal)
        self.cancel_all(refusal)

    def _end(self, ending: Callable[[Goal], None]) -> None:
        goal, self.active = self.active, None
        if goal is not None:
            ending(goal)


class Goals:
    """All goals of an asset: a queue for each branch of the tree that works on them.

    Attributes:
        motion, camera, instant: goals that move the rover, that use the camera, and that are done
            in the tick in which they begin.
    """

    def __init__(self, clock: Clock) -> None:
        self.motion = GoalQueue(clock)
        self.camera = GoalQueue(clock)
        self.instant = GoalQueue(clock)

    def __iter__(self) -> Iterator[GoalQueue]:
        return iter((self.motion, self.camera, self.instant))

    def __len__(self) -> int:
        return sum(map(len, self))

    @property
    def waiting(self) -> int:
        """How many goals wait, without those that are active."""
        return sum(queue.waiting for queue in self)

    @property
    def active(self) -> Goal | None:
        """The first active goal, that of the motion before that of the camera."""
        return next((queue.active for queue in self if queue.active is not None), None)

    def add(self, request: Motion | CameraWork | InstantCommand, life: Life) -> None:
        """Put an accepted command's goal at the end of the queue that its request belongs to."""
        if isinstance(request, Motion):
            self.motion.add(life)
        elif isinstance(request, CameraWork):
            self.camera.add(life)
        else:
            self.instant.add(life)

    def cancel(self, life: Life, refusal: Refusal) -> None:
        """End one goal, waiting or active, as cancelled; others go on."""
        for queue in self:
            queue.cancel(life, refusal)

    def cancel_all(self, refusal: Refusal) -> None:
        """End every goal as cancelled."""
        for queue in self:
            queue.cancel_all(refusal)

    def fail_active(self, refusal: Refusal) -> None:
        """End the active goals without success."""
        for queue in self:
            queue.fail(refusal)


@dataclass(frozen=True, slots=True)
class Context:
    """One asset's state, goals and intents, handed to every leaf.

    Attributes:
        video: None where the asset has none.
    """

    clock: Clock
    settings: Settings
    status: Status
    goals: Goals
    locomotion: Locomotion
    files: FileFolder
    video: Video | None = None
    intents: Intents = field(default_factory=Intents)
    latches: Latches = field(default_factory=Latches)
    plans: ActivePlans = field(default_factory=ActivePlans)
