"""`check_pose`: refuses a motion to an absolute target while the pose is too uncertain for it.

EXECUTED guarantees 15 cm plus 5 % of the distance to the target, and 0.1 rad of its heading. The
motion's own deviation, the tolerances of its settings, adds to the uncertainty.
"""

from executive.commands import Line, Motion, Reference, Request
from executive.settings import Settings
from executive.state import PROMISED_M, PROMISED_RAD, PROMISED_RATIO, RECOVERY, Uncertainty
from executive.values.geometry import Pose
from executive.values.quantities import angle_text
from executive.values.reasons import Figure, Reason, Refusal


def check_pose(
    request: Request, start: Pose, uncertainty: Uncertainty, settings: Settings
) -> Refusal | None:
    """Return a refusal if the pose is too uncertain for absolute targets of a motion, or None.

    Relative motions are never refused: they report their start pose.

    Args:
        request: any request; only motions to absolute targets are refused.
        start: start pose.
        uncertainty: uncertainty of the pose.
        settings: provide the tolerances of motions.
    """
    if not isinstance(request, Motion):
        return None
    segments = request.segments(start)
    if all(each.reference is not Reference.FRAME for each in segments):
        return None
    refusal, driven_m = check_target(0.0, 0.0, uncertainty, settings), 0.0
    for segment in segments:
        if isinstance(segment, Line):
            leg_m = abs(segment.by_m)
            driven_m += leg_m
            at_target_m = uncertainty.position_at_m(driven_m)
            refusal = refusal or check_target(leg_m, at_target_m, uncertainty, settings)
    return refusal


def check_target(
    distance_m: float, position_m: float, uncertainty: Uncertainty, settings: Settings
) -> Refusal | None:
    """Return a refusal if a target cannot be, or was not, reached as EXECUTED guarantees, or None.

    Args:
        distance_m: distance from the start of the motion to the target.
        position_m: position uncertainty at the target.
        uncertainty: uncertainty of the present pose.
        settings: provide the tolerances of motions.
    """
    law = settings.turn_drive
    bound_rad = PROMISED_RAD - law.heading_tolerance_rad
    bound_m = PROMISED_M + PROMISED_RATIO * distance_m - law.position_tolerance_m
    if not uncertainty:
        return None
    if uncertainty.heading_rad > bound_rad:
        text = f"the heading is uncertain by {angle_text(uncertainty.heading_rad)}, above"
        bound = Figure("heading bound", bound_rad, "rad")
        return _uncertain(uncertainty, f"{text} {angle_text(bound_rad)}", bound)
    if position_m > bound_m:
        text = f"the position is uncertain by {position_m:.2f} m at the target, above"
        bound = Figure("position bound", bound_m, "m")
        return _uncertain(uncertainty, f"{text} {bound_m:.2f} m", bound)
    return None


def _uncertain(uncertainty: Uncertainty, text: str, bound: Figure) -> Refusal:
    return Refusal(
        Reason.POSE_UNCERTAIN,
        f"{text}, since {uncertainty.cause}: {RECOVERY}",
        (*uncertainty.figures, bound),
        cause=uncertainty.confirmed_by,
    )
