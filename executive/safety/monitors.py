"""When the rover must stand by itself, whatever was commanded."""

from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings
from executive.state import Status


def find_hazard(status: Status, settings: Settings, moving: bool) -> Refusal | None:
    """Return what makes motion unsafe now, or None.

    Args:
        status: what the sensors say.
        settings: the asset's bounds.
        moving: whether a motion goal is under way; stale odometry matters only then.
    """
    bounds = settings.safety
    if status.jump is not None:
        return status.jump
    if moving and not status.odometry_fresh:
        age_s = status.odometry_age_s
        return Refusal(
            Reason.ODOMETRY_STALE,
            f"odometry is {age_s:.2f} s old",
            (Figure("age", age_s, "s"), Figure("bound", bounds.odometry_stale_s, "s")),
        )
    tilt_rad = max(abs(status.pose.roll_rad), abs(status.pose.pitch_rad))
    if tilt_rad > bounds.tilt_rad:
        return Refusal(
            Reason.TILTED,
            f"the rover leans by {tilt_rad:.2f} rad",
            (Figure("tilt", tilt_rad, "rad"), Figure("bound", bounds.tilt_rad, "rad")),
        )
    if status.battery is not None and status.battery.voltage_v < bounds.battery_low_v:
        voltage_v = status.battery.voltage_v
        return Refusal(
            Reason.BATTERY_LOW,
            f"the battery is down to {voltage_v:.1f} V",
            (Figure("voltage", voltage_v, "V"), Figure("bound", bounds.battery_low_v, "V")),
        )
    return None
