"""`NavigationSettings`: the navigation below the executive; `MuxSettings`: the mux of the base."""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from executive.settings.settings_files import MAX_VALUE, require_above_zero

MAX_PRIORITY: Final = 255
MAX_LOCK_TIMEOUT_S: Final = 0.5
"""Maximum timeout of the navigation's lock: the rover is stationary within this time and braking
after the executive and its guard have ended."""


@dataclass(frozen=True, slots=True)
class MuxEntry:
    """An input or a lock of a mux, in the terms of twist_mux.

    Attributes:
        topic: topic of the messages: geometry_msgs/Twist of an input, std_msgs/Bool of a lock.
        timeout: seconds without a message after which an input is inactive, and a lock is
            locked; 0 for never.
        priority: an input is masked by inputs and locks of a higher priority.
    """

    topic: str
    timeout: float
    priority: int

    def __post_init__(self) -> None:
        """Raise ValueError if twist_mux would interpret a value differently."""
        if not 0.0 <= self.timeout <= MAX_VALUE:
            raise ValueError(f"timeout is {self.timeout}: 0 for never, or seconds above it")
        if not 0 <= self.priority <= MAX_PRIORITY:
            raise ValueError(f"priority is {self.priority}: 0 to {MAX_PRIORITY}")


@dataclass(frozen=True, slots=True)
class MuxSettings:
    """The mux between velocity publishers and the base.

    Attributes:
        input: the executive's own input in `topics`.
        lock: the lock in `locks` that the executive holds while the rover must be stationary.
        topics, locks: as in the file of twist_mux.
        stop: the input in `topics` that then receives zero from the executive, of the lock's
            priority or a higher one; None: a locked base stops after its own timeout.
        lower_may_drive: whether inputs of a lower priority than the executive's may drive the rover
            while it is idle; if not, it is STOPPED when it moves by them.
    """

    input: str
    lock: str
    topics: dict[str, MuxEntry]
    locks: dict[str, MuxEntry]
    stop: str | None = None
    lower_may_drive: bool = True

    def __post_init__(self) -> None:
        """Raise ValueError if the executive's own input or lock is missing or ineffective."""
        for key, name, there in (
            ("input", self.input, self.topics),
            ("lock", self.lock, self.locks),
            ("stop", self.stop, self.topics),
        ):
            if name is not None and name not in there:
                known = ", ".join(there) or "none"
                raise ValueError(f"{key} is {name!r}, which the mux does not have: {known}")
        own, lock = self.topics[self.input].priority, self.locks[self.lock].priority
        if lock <= own:
            raise ValueError(
                f"lock {self.lock} has priority {lock}: it must be above {own}, that of"
                f" {self.input}, or it has no effect"
            )
        if self.stop is not None and self.topics[self.stop].priority < lock:
            raise ValueError(
                f"stop {self.stop} has priority {self.topics[self.stop].priority}: it must be at"
                f" least {lock}, that of {self.lock}, which masks it otherwise"
            )


@unique
class NavigationGate(Enum):
    """What passes the navigation's velocity to the base.

    Attributes:
        LOCK: a lock of the base's mux, which an executive that has ended no longer holds open.
        RELAY: the executive, which publishes the navigation's velocity itself.
    """

    LOCK = "lock"
    RELAY = "relay"


@unique
class RelativeActions(Enum):
    """Actions that carry out moveForward and rotateBy.

    Attributes:
        OFF: none; the executive drives them itself.
        NAV2: drive_on_heading and spin of Nav2.
        CREATE3: drive_distance and rotate_angle of a Create 3.
    """

    OFF = "off"
    NAV2 = "nav2"
    CREATE3 = "create3"


@dataclass(frozen=True, slots=True)
class NavigationSettings:
    """The navigation: Nav2's action servers or others with these interfaces.

    Attributes:
        gate: what passes its velocity to the base.
        input: its input in `mux.topics`, if the gate is a lock.
        lock: the lock of that input in `mux.locks`, if the gate is a lock.
        selectable: whether commands may select it if the asset's controller is another.
        finish_within_m: maximum distance of its end from the target; the executive drives the rest
            itself.
        recovery_s: added to the deadline of a motion for the navigation's recoveries.
        speed_mps: speed of its drives on average, for deadlines and predictions. Nav2's controllers
            have 0.26 or 0.5 m/s by default; half of it is still in time.
        passing_m: radius within which it counts an intermediate pose as passed.
        relative: actions that carry out moveForward and rotateBy.
    """

    gate: NavigationGate
    input: str | None = None
    lock: str | None = None
    selectable: bool = True
    finish_within_m: float = 0.5
    recovery_s: float = 60.0
    speed_mps: float = 0.5
    passing_m: float = 0.7
    relative: RelativeActions = RelativeActions.OFF

    def __post_init__(self) -> None:
        """Raise ValueError unless the figures are positive, and the gate has its names."""
        require_above_zero(self, "finish_within_m", "recovery_s", "speed_mps", "passing_m")
        named = [each for each in (self.input, self.lock) if each is not None]
        if len(named) != (2 if self.gate is NavigationGate.LOCK else 0):
            raise ValueError(
                "input and lock, the navigation's in the mux, are needed if gate is lock, and not"
                " known if it is relay"
            )

    def check_gate(self, mux: MuxSettings | None) -> None:
        """Raise ValueError unless the gate shuts the navigation off, and nothing else."""
        if self.input is None or self.lock is None:
            return
        if mux is None:
            raise ValueError("navigation.gate is lock: add the section mux, or set it to relay")
        topic, gate = mux.topics.get(self.input), mux.locks.get(self.lock)
        if topic is None or gate is None:
            raise ValueError(
                f"navigation.input {self.input} or navigation.lock {self.lock} is not in the mux:"
                f" known are {', '.join((*mux.topics, *mux.locks))}"
            )
        if self.input in {mux.input, mux.stop} or self.lock == mux.lock:
            raise ValueError("navigation.input and navigation.lock are those of the executive")
        if not 0.0 < gate.timeout <= MAX_LOCK_TIMEOUT_S:
            raise ValueError(
                f"lock {self.lock} has timeout {gate.timeout:g}: above 0, so that it is locked"
                f" without an executive, and at most {MAX_LOCK_TIMEOUT_S:g} s"
            )
        lowest = min(each.priority for name, each in mux.topics.items() if name != self.input)
        if not topic.priority < gate.priority <= lowest:
            raise ValueError(
                f"lock {self.lock} has priority {gate.priority}: it must be above"
                f" {topic.priority}, that of {self.input}, and at most {lowest}, so that it masks"
                " no other input"
            )
