"""One line that says why the rover stands, or what moves it."""

from executive.context import Context
from executive.geometry import STANDING, Velocity
from executive.modes import Mode


def mode_of(context: Context) -> Mode:
    """Return the asset's mode, which follows from what holds and what is under way."""
    if context.latches.hazard is not None:
        return Mode.SAFE
    if context.latches.stopped_by is not None:
        return Mode.STOPPED
    if not len(context.motion):
        return Mode.IDLE
    active = context.motion.active
    return Mode.TELEOP if active is not None and active.is_velocity else Mode.MOVING


def why(context: Context, velocity: Velocity) -> str:
    """Return the reason for what the rover does now.

    Args:
        context: the asset's state and goals.
        velocity: what the arbiter last sent.
    """
    latches, active = context.latches, context.motion.active
    if latches.hazard is not None:
        return f"stands: SAFE because {latches.hazard.text}; resume when that is mended"
    if latches.stopped_by is not None:
        return f"stands: stopped by {latches.stopped_by}; resume to go on"
    if not context.status.odometry_fresh:
        return "stands: no odometry"
    foreign = f" (also publishing: {', '.join(context.status.foreign)})"
    others = foreign if context.status.foreign else ""
    if active is None:
        return f"stands: no motion goal{others}"
    doing = f"{active.command.identity} {active.command.name}"
    if velocity == STANDING:
        return f"stands for a moment within {doing}{others}"
    return (
        f"moves at {velocity.travel_mps:+.2f} m/s, {velocity.rotate_radps:+.2f} rad/s"
        f" for {doing}{others}"
    )
