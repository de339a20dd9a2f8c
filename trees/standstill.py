"""Which sources of motion confirm standstill, for leaves at a stop and at the end of a motion."""

from typing import Final

from executive.goals import Context
from executive.state import SourceMotion
from executive.values.reasons import Figure, Reason, Refusal

STOP_DEADLINE_S: Final = 5.0
"""Time for each source to confirm standstill, from a stop or the end of a motion."""
_BY_WHEELS: Final = frozenset({"odometry", "joints", "gyro"})


def sources(context: Context) -> tuple[SourceMotion, ...]:
    """Return the motion of the rover by each source that was ever received."""
    over_ground = context.safety.history.over_ground
    felt = None if over_ground is None else over_ground.motion(context.clock.now_s())
    known = context.status.standstill.by_source()
    return known if felt is None else (*known, felt)


def beside_odometry(context: Context) -> tuple[SourceMotion, ...]:
    """Return the sources that the end of a motion waits for, besides those that verify it."""
    return tuple(
        each
        for each in sources(context)
        if each.source == "accelerometer" or (each.awaited and each.source in _BY_WHEELS)
    )


def unconfirmed(context: Context, found: tuple[SourceMotion, ...]) -> str:
    """Return a text of the sources without confirmed standstill; empty if all confirm it."""
    texts = [str(each) for each in found if not each.is_standing]
    if not _odometry_shows(context):
        texts.insert(0, "no odometry")
    if context.safety.sliding is not None:
        texts.append(context.safety.sliding.refusal.text)
    return "; ".join(texts)


def _odometry_shows(context: Context) -> bool:
    """Return whether odometry is fresh enough for control, and shows standstill."""
    shows = (each.source == "odometry" for each in context.status.standstill.by_source())
    return context.status.odometry_fresh and any(shows)


def awaited(context: Context, found: tuple[SourceMotion, ...]) -> bool:
    """Return whether no source shows motion, but one has not been received yet."""
    sure = _odometry_shows(context) and context.safety.sliding is None
    return sure and all(each.is_standing or each.awaited for each in found)


def refusal(context: Context, found: tuple[SourceMotion, ...], bound_s: float) -> Refusal:
    """Return the refusal for an unconfirmed standstill, with the figures of each source."""
    text = f"standstill not confirmed within {bound_s:.0f} s: "
    text += unconfirmed(context, found)
    figures = (
        Figure("bound", bound_s, "s"),
        *(figure for each in found for figure in each.figures),
    )
    if awaited(context, found):
        return Refusal(Reason.UNVERIFIED, text, figures)
    moving = {each.source for each in found if not each.is_standing}
    if not context.status.odometry_fresh or moving & _BY_WHEELS:
        return Refusal(Reason.STOP_DEADLINE, text, figures)
    over_ground, slid = context.safety.history.over_ground, context.safety.sliding
    if over_ground is not None:
        lost = over_ground.lost_speeds
        text += f"; {', '.join(f'{each.name} {each.value:.2f} m/s' for each in lost)}"
        figures += lost
    reason = Reason.SLIDE_AT_REST if slid is None else slid.refusal.reason
    return Refusal(reason, f"{text}. Check that the rover is stationary before resume", figures)
