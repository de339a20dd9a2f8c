"""`MpcSettings`: settings of model predictive control: yaw response, slip, delays."""

from dataclasses import dataclass, field
from math import copysign, sqrt
from typing import Final

from executive.settings.settings_files import require_above_zero


@dataclass(frozen=True, slots=True)
class YawResponse:
    """Yaw response: turning rate w for the commanded rate wc at speed v and acceleration a.

    w = gain wc - drag_radps tanh(wc / drag_at_radps) + e, where e approaches
    wc |wc| (travel v + travel_squared v^2 + speed |v| - (acceleration + acceleration_travel v) a)
    - load a wc with the time constant lag_s. SI units and radians; by default w equals wc.
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
        """Raise ValueError unless divisors and gain are positive."""
        require_above_zero(self, "gain", "drag_at_radps", "lag_s")


@dataclass(frozen=True, slots=True)
class SlipSettings:
    """Slip of a turning rover, at speed v, turning rate w and acceleration a.

    Velocity to the left: -(offset + gain sign(v) sqrt|v w| - acceleration a) w. The centre of
    rotation lies ahead of base_link by the expression in brackets. Braking loads the front wheels,
    which then slip less, and so moves this centre ahead. Velocity ahead: -creep a |w|. Wheels that
    are dragged laterally push the rover only while they also slip longitudinally.

    Attributes:
        offset_m: offset of the centre of rotation in a spin.
        gain_m: for v in m/s and w in rad/s.
        acceleration_s2: m for each m/s².
        creep_s2: m/s for each m/s² and rad/s.
        lag_s: time constant of all terms except the offset.
    """

    offset_m: float = 0.0
    gain_m: float = 0.0
    acceleration_s2: float = 0.0
    creep_s2: float = 0.0
    lag_s: float = 0.0

    def side_slip_m(self, travel_mps: float, rotate_radps: float) -> float:
        """Return the side slip at constant speed, to the right per radian turned left."""
        return self.offset_m + self.speed_slip_m(travel_mps, rotate_radps)

    def speed_slip_m(self, travel_mps: float, rotate_radps: float) -> float:
        """Return its part that depends on the speeds."""
        return self.gain_m * copysign(sqrt(abs(travel_mps * rotate_radps)), travel_mps)

    def __post_init__(self) -> None:
        """Raise ValueError unless the lag is 0 to 1 s."""
        if not 0.0 <= self.lag_s <= 1.0:
            raise ValueError(f"lag_s is {self.lag_s}: 0 to 1")


TYPICAL_SLIP: Final = SlipSettings(offset_m=0.044, gain_m=0.065)
"""Side slip that monitors assume of an asset without figures: that of a skid-steered rover of 20 kg
(the Jackal's, measured). A base that does not slip remains within their bounds."""

MIN_STEPS: Final = 10
MAX_STEPS: Final = 100


@dataclass(frozen=True, slots=True)
class MpcSettings:
    """Model predictive control.

    Attributes:
        steps: intervals of a trajectory; more are finer and cost more.
        command_delay_s: delay from a tick to its commanded velocity, as the ramp between ticks.
        odometry_age_s: age of odometry on arrival.
        odometry_slip: the part of the slip that its odometry compensates; the executive compensates
            the rest. None: all of it.
        selectable: whether commands may select it if the asset's controller is another.
    """

    steps: int = 20
    command_delay_s: float = 0.05
    odometry_age_s: float = 0.02
    yaw: YawResponse = field(default_factory=YawResponse)
    slip: SlipSettings = field(default_factory=SlipSettings)
    odometry_slip: SlipSettings | None = None
    selectable: bool = False

    @property
    def measured_slip(self) -> SlipSettings:
        """The slip that the odometry contains; without figures `TYPICAL_SLIP`."""
        slip = self.odometry_slip or self.slip
        return TYPICAL_SLIP if slip == SlipSettings() else slip

    def __post_init__(self) -> None:
        """Raise ValueError unless every figure is within its bounds."""
        if not MIN_STEPS <= self.steps <= MAX_STEPS:
            raise ValueError(f"steps is {self.steps}: {MIN_STEPS} to {MAX_STEPS}")
        for name in ("command_delay_s", "odometry_age_s"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is {getattr(self, name)}: 0 to 1")
