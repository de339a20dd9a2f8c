"""What model predictive control knows of a rover: how it turns and slips, and what comes late."""

from dataclasses import dataclass, field
from typing import Final

from executive.settings.settings_files import require_above_zero


@dataclass(frozen=True, slots=True)
class YawResponse:
    """How fast a rover turns, w, when wc is commanded at the speed v and acceleration a.

    w = gain wc - drag_radps tanh(wc / drag_at_radps) + e, where e goes to
    wc |wc| (travel v + travel_squared v^2 + speed |v| - (acceleration + acceleration_travel v) a)
    - load a wc with the time constant lag_s. SI units and radians; without any of it w is wc.
    """

    gain: float = 1.0
    drag_radps: float = 0.0
    drag_at_radps: float = 0.15
    lag_s: float = 0.18
    travel: float = 0.0
    travel_squared: float = 0.0
    speed: float = 0.0
    acceleration: float = 0.0
    acceleration_travel: float = 0.0
    load: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where a divisor is none, or the rover would not turn."""
        require_above_zero(self, "gain", "drag_at_radps", "lag_s")


@dataclass(frozen=True, slots=True)
class SlipSettings:
    """How a turning rover slips, at the speed v, the rate of turn w and the acceleration a.

    To its left by -(offset + gain sign(v) sqrt|v w| - acceleration a) w: the point about which it
    turns lies ahead of base_link by what is in brackets. Braking puts load on the front wheels,
    which then slip less, and so moves that point ahead. Ahead by -creep a |w|: wheels that are
    dragged aside push the rover only where they slip along, too.

    Attributes:
        offset_m: in a spin.
        gain_m: for v in m/s and w in rad/s.
        acceleration_s2: m for each m/s².
        creep_s2: m/s for each m/s² and rad/s.
        lag_s: the time constant with which all but the offset settles.
    """

    offset_m: float = 0.0
    gain_m: float = 0.0
    acceleration_s2: float = 0.0
    creep_s2: float = 0.0
    lag_s: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError where the lag is none that can be."""
        if not 0.0 <= self.lag_s <= 1.0:
            raise ValueError(f"lag_s is {self.lag_s}: 0 to 1")


FEWEST_STEPS: Final = 10
MOST_STEPS: Final = 100


@dataclass(frozen=True, slots=True)
class MpcSettings:
    """Model predictive control.

    Attributes:
        steps: intervals of a plan; more are finer and cost more.
        command_delay_s: from a tick to the velocity that it commands, as the ramp between ticks.
        odometry_age_s: how old odometry is when it arrives.
        yaw: how the rover turns.
        slip: how it slips.
        odometry_slip: the part of that which its odometry allows for; the executive allows for the
            rest. None: all of it.
        offered: whether commands may choose it where the asset's controller is another.
    """

    steps: int = 20
    command_delay_s: float = 0.05
    odometry_age_s: float = 0.02
    yaw: YawResponse = field(default_factory=YawResponse)
    slip: SlipSettings = field(default_factory=SlipSettings)
    odometry_slip: SlipSettings | None = None
    offered: bool = False

    def __post_init__(self) -> None:
        """Raise ValueError where a figure is none that can be."""
        if not FEWEST_STEPS <= self.steps <= MOST_STEPS:
            raise ValueError(f"steps is {self.steps}: {FEWEST_STEPS} to {MOST_STEPS}")
        for name in ("command_delay_s", "odometry_age_s"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}: 0 to 1")
