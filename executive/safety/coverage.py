"""What an asset cannot monitor, for want of a sensor, or because its file says so."""

from executive.fault_declaration import Then
from executive.settings import LocomotionKind, Settings


def unmonitored(settings: Settings) -> tuple[str, ...]:
    """Return a sentence for each thing that is not monitored on an asset, and why."""
    sensors = settings.sensors
    lacking = (
        (sensors.joints, "wheels that do not follow their command", "no wheel sensors"),
        (sensors.imu, "a wrong gyro, and wheels that spin", "no IMU"),
        (sensors.second_odometry, "slip", "no second odometry"),
        (sensors.laser, "what stands in the way", "no laser"),
        (settings.mass_kg, "pushing against something", "mass_kg is not given"),
    )
    missing = [f"{what}: {why}" for there, what, why in lacking if there is None]
    if settings.locomotion is LocomotionKind.WHOLE_MOTION:
        missing.append("moving while it should stand: it may be commanded by another link")
    ignored = [f"{each.name}: ignored" for each, row in settings.faults if row.then is Then.IGNORE]
    return tuple(f"not monitored is {text}" for text in (*missing, *ignored))
