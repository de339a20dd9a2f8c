"""The mode of the asset, and one line on why the rover stands or what moves it."""

from executive.commands import Command, Mode
from executive.commands.intake import PLAN_LINK
from executive.geometry import STANDING, Velocity
from executive.goals import Context
from executive.safety import find_hazard


def mode_of(context: Context) -> Mode:
    """Return the asset's mode: it follows from latches, plans and motion goals."""
    if context.latches.hazard is not None:
        return Mode.SAFE
    if context.latches.stopped_by is not None:
        return Mode.STOPPED
    if context.plans.executing is not None:
        return Mode.PLAN
    moving = _motion(context)
    return Mode.PAUSED if moving is Mode.IDLE and context.plans.suspended else moving


def mode_for(context: Context, command: Command) -> Mode:
    """Return the mode by which a command is judged: PLAN does not refuse the plan's own."""
    mode = mode_of(context)
    return _motion(context) if mode is Mode.PLAN and command.link == PLAN_LINK else mode


def _motion(context: Context) -> Mode:
    if not len(context.goals.motion):
        return Mode.IDLE
    active = context.goals.motion.active
    return Mode.TELEOP if active is not None and active.is_velocity else Mode.MOVING


def explain(context: Context, velocity: Velocity) -> str:
    """Return the reason for what the rover does now.

    Args:
        context: the asset's state and goals.
        velocity: what the arbiter last sent.
    """
    latches, active = context.latches, context.goals.motion.active
    if latches.hazard is not None:
        over = find_hazard(context.status, context.settings, moving=True) is None
        way_out = "that is over: resume to go on" if over else "resume when that is mended"
        return f"stands: SAFE because {latches.hazard.text}; {way_out}"
    if latches.stopped_by is not None:
        return f"stands: stopped by {latches.stopped_by}; resume to go on"
    if not context.status.odometry_fresh:
        return "stands: no odometry"
    foreign = f" (also publishing: {', '.join(context.status.foreign)})"
    others = foreign if context.status.foreign else ""
    if active is None:
        return f"stands: {_idle(context)}{others}"
    doing = f"{active.command.identity} {active.command.name}"
    if velocity == STANDING:
        return f"stands for a moment within {doing}{others}"
    return (
        f"moves at {velocity.travel_mps:+.2f} m/s, {velocity.rotate_radps:+.2f} rad/s"
        f" for {doing}{others}"
    )


def _idle(context: Context) -> str:
    plans = context.plans
    if plans.executing is not None:
        return f"plan {plans.executing} moves nothing now"
    if plans.suspended:
        names, first = ", ".join(plans.suspended), plans.suspended[0]
        way_out = f"resumePlan {first} (`rover plan resume {first}`) to go on"
        return f"plan {names} is suspended; {way_out}"
    return "no motion goal"
