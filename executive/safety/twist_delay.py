"""`TwistDelay`: the delay of the odometry's twist relative to its pose, learnt or declared.

Some drivers publish the mean velocity of the last steps, or an older one. The received twist is
compared with each kind: the mean of `steps` steps of the pose, without the last `behind`.
"""

from collections import deque
from typing import Final, NamedTuple

from executive.values.geometry import Velocity


class TwistKind(NamedTuple):
    """A twist that is the mean of `steps` steps of the pose, without the last `behind`."""

    steps: int
    behind: int


_MOMENTARY: Final = TwistKind(1, 0)
TWIST_KINDS: Final = (
    _MOMENTARY,
    *(TwistKind(steps, 0) for steps in range(2, 21)),
    *(TwistKind(steps, behind) for steps in range(1, 6) for behind in range(1, 11)),
)
_POSES: Final = 1 + max(kind.steps + kind.behind for kind in TWIST_KINDS)
FORGETTING: Final = 0.998
"""Factor of an error with each message that differs."""
TURN_M: Final = 0.2
"""Weight of a rate relative to a speed."""
SAME_M2PS2: Final = 4e-6
"""Square of a difference that a momentary twist may have; such messages are ignored. While the
twist counts as momentary, so are those with less change of the twist over all steps: at rest a mean
over many steps fits the noise of the pose."""
KNOWN_M2PS2: Final = 2e-3
"""Minimum sum of the squares of a momentary twist, for another one to be taken."""
KNOWN_MESSAGES: Final = 6
"""Minimum number of messages that differ: at first a frozen pose fits a mean."""
TAKEN_RATIO: Final = 0.02
"""Maximum error of the kind that is taken, relative to a momentary twist. Recorded robots: a mean
of 10 steps at 10 Hz leaves 1.7 mm/s of 0.16 m/s."""
LEFT_RATIO: Final = 0.5
"""The same, above which the twist counts as momentary again."""
SHIFTS: Final = 8
"""Number of parts of the delay: the pose is shifted by each of them for comparison."""


class TwistDelay:
    """The delay of the twist.

    Args:
        declared_s: its averaging time, as the asset declares it; None: learnt.

    Attributes:
        delay_s: maximum age of the motion that the twist contains; 0 if it is momentary.
    """

    def __init__(self, declared_s: float | None = None) -> None:
        self._declared = declared_s is not None
        self.delay_s = declared_s or 0.0
        self._poses: deque[tuple[float, float, float]] = deque(maxlen=_POSES)
        self._twists: deque[Velocity] = deque(maxlen=_POSES)
        self._errors = [0.0] * len(TWIST_KINDS)
        self._messages = 0

    def observe(
        self, time_s: float, distance_m: float, turn_rad: float, velocity: Velocity, period_s: float
    ) -> None:
        """Learn from a message.

        Args:
            time_s: its stamp.
            distance_m: of the pose since the start, signed.
            turn_rad: likewise.
            velocity: its twist.
            period_s: of the odometry.
        """
        if self._declared:
            return
        poses, twists = self._poses, self._twists
        poses.append((time_s, distance_m, turn_rad))
        twists.append(velocity)
        if len(poses) < _POSES or self._error(_MOMENTARY, velocity) <= SAME_M2PS2:
            return
        changed = _square(velocity, twists[0].travel_mps, twists[0].rotate_radps) > SAME_M2PS2
        if not (changed or self.delay_s):
            return
        self._messages += 1
        self._errors = [
            FORGETTING * error + self._error(kind, velocity)
            for kind, error in zip(TWIST_KINDS, self._errors, strict=True)
        ]
        momentary, least = self._errors[0], min(self._errors)
        known = momentary > KNOWN_M2PS2 and self._messages >= KNOWN_MESSAGES
        if known and least < TAKEN_RATIO * momentary:
            kind = TWIST_KINDS[self._errors.index(least)]
            self.delay_s = (kind.steps - 1 + kind.behind) * period_s
        elif least > LEFT_RATIO * momentary:
            self.delay_s = 0.0

    def _error(self, kind: TwistKind, velocity: Velocity) -> float:
        last, first = self._poses[-1 - kind.behind], self._poses[-1 - kind.behind - kind.steps]
        span_s = last[0] - first[0]
        return _square(velocity, (last[1] - first[1]) / span_s, (last[2] - first[2]) / span_s)

    @property
    def shifts_s(self) -> tuple[float, ...]:
        """The shifts of the motion of the pose, for comparison."""
        return tuple(self.delay_s * part / SHIFTS for part in range(SHIFTS + 1))


def _square(velocity: Velocity, travel_mps: float, rotate_radps: float) -> float:
    off_radps = TURN_M * (velocity.rotate_radps - rotate_radps)
    return (velocity.travel_mps - travel_mps) ** 2 + off_radps * off_radps
