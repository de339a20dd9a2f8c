"""How the emulated brick is built, and how good it is."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BrickSettings:
    """One brick.

    Attributes:
        name: under which it is commanded, and speaks.
        wheel_radius_m, track_m: what its program was told of the rover.
        track_error: bounds of how much the track is misjudged, as a ratio; the sign is drawn too.
        latency_s: bounds of the time from the last octet of a command to its reply.
        telemetry_s: between two messages of telemetry.
        travel_mps, rotate_radps: the fastest it can be told to move.
        first_travel_mps, first_rotate_radps: how fast it moves until it is told.
        rim_mps2: how fast the speed of a wheel's rim is changed, but at a stop.
        creep_mps: how slowly it goes the last millimetres.
        stuck_s: after this a wheel that shall turn and does not is taken for stuck.
        hold_s: the longest time that it holds a velocity.
        host_rate: seconds of its own time for each second of its host's.
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
