"""`BrickSettings`: construction and accuracy of the emulated brick."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BrickSettings:
    """One brick.

    Attributes:
        name: its name in messages.
        wheel_radius_m, track_m: dimensions of the rover in its program.
        track_error: bounds of the relative error of its track; the sign is drawn too.
        latency_s: bounds of the time from the last octet of a command to its reply.
        telemetry_s: period of telemetry.
        travel_mps, rotate_radps: maximum speeds that can be set.
        first_travel_mps, first_rotate_radps: speeds until they are set.
        rim_mps2: acceleration of a wheel's rim, except at a stop.
        creep_mps: speed over the last millimetres.
        stuck_s: time after which a driven wheel that does not turn counts as stuck.
        hold_s: maximum duration of a held velocity.
        host_rate: seconds of its own clock per second of its host's.
    """

    name: str = "MOCUP"
    wheel_radius_m: float = 0.0408
    track_m: float = 0.16
    track_error: tuple[float, float] = (0.01, 0.02)
    latency_s: tuple[float, float] = (0.05, 0.1)
    telemetry_s: float = 0.2
    travel_mps: float = 0.3
    rotate_radps: float = 2.0
    first_travel_mps: float = 0.1
    first_rotate_radps: float = 0.5
    rim_mps2: float = 0.4
    creep_mps: float = 0.012
    stuck_s: float = 1.0
    hold_s: float = 600.0
    host_rate: float = 1.0
