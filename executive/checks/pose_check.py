"""Whether the pose is certain enough for a motion to an absolute target.

EXECUTED promises 15 cm and 5 % of the distance to the target, and 0.1 rad of its heading. What the
motion itself may be off by, the tolerances of its settings, comes on top of the uncertainty.
"""

from executive.commands import FollowPath, MoveTo, Request, RotateTo
from executive.geometry import Point, Pose
from executive.reasons import Figure, Reason, Refusal
from executive.settings import Settings
from executive.state import PROMISED_M, PROMISED_RAD, PROMISED_RATIO, Uncertainty


def check_pose(
    request: Request,
    start: Pose,
    uncertainty: Uncertainty,
    settings: Settings,
    *,
    arrived: bool = False,
) -> Refusal | None:
    """Return that the pose is too uncertain for a motion to an absolute target, or None.

    Relative motions are never refused: they say from where they ran.

    Args:
        request: any; what is no such motion is not refused.
        start: where it begins, or began.
        uncertainty: of the pose.
        settings: have the tolerances of motions.
        arrived: whether the motion is over, so that nothing is added for what is to be driven.
    """
    law = settings.turn_drive
    if not uncertainty or not isinstance(request, MoveTo | FollowPath | RotateTo):
        return None
    bound_rad = PROMISED_RAD - law.heading_tolerance_rad
    refusal = None
    if uncertainty.heading_rad > bound_rad:
        refusal = _uncertain(
            uncertainty,
            f"the heading is uncertain by {uncertainty.heading_rad:.2f} rad, above"
            f" {bound_rad:.2f} rad",
            Figure("heading bound", bound_rad, "rad"),
        )
    for distance_m in _distances_m(request, start):
        bound_m = PROMISED_M + PROMISED_RATIO * distance_m - law.position_tolerance_m
        at_target_m = uncertainty.position_at_m(0.0 if arrived else distance_m)
        if refusal is None and at_target_m > bound_m:
            refusal = _uncertain(
                uncertainty,
                f"the position is uncertain by {at_target_m:.2f} m at the target, above"
                f" {bound_m:.2f} m",
                Figure("position bound", bound_m, "m"),
            )
    return refusal


def _distances_m(request: MoveTo | FollowPath | RotateTo, start: Pose) -> list[float]:
    match request:
        case MoveTo(target):
            waypoints = (target,)
        case FollowPath(waypoints):
            pass
        case RotateTo():
            return []
    return [start.point.distance_m(Point(each.x_m, each.y_m)) for each in waypoints]


def _uncertain(uncertainty: Uncertainty, text: str, bound: Figure) -> Refusal:
    way_out = "correct the pose by setPositionCompensation, or confirm it by confirmPose"
    return Refusal(
        Reason.POSE_UNCERTAIN,
        f"{text}, since {uncertainty.cause}: {way_out}",
        (*uncertainty.figures, bound),
    )
