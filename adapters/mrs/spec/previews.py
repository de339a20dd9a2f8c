"""Converts preview requests and previews to the wire and back."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from adapters.mal import MalError
from adapters.mrs.spec import types
from adapters.mrs.spec.errors import AreaError, with_text
from adapters.mrs.spec.mapping import FRAME, REQUESTS, invocation
from executive.commands import Family, Motion, Waypoint, all_declarations
from executive.values.reasons import Refusal

if TYPE_CHECKING:
    from executive.preview import Preview, StepPreview, TimedPose

_MOTIONS: Final = {
    each.operation: each for each in all_declarations() if each.family is Family.MOTION
}


@dataclass(frozen=True, slots=True)
class PreviewRequest:
    """A motion to preview: the parts of the operation `preview`."""

    operation: str
    waypoints: tuple[types.Waypoint, ...] | None
    figures: tuple[float, ...] | None
    controller: types.Controller | None = None


def preview_request(motion: Motion) -> PreviewRequest:
    """Return the preview request of a motion."""
    call = invocation(motion)
    match call.parts:
        case (types.Waypoint() as target, controller):
            return PreviewRequest(call.operation, (target,), None, controller)
        case (tuple() as waypoints, controller):
            return PreviewRequest(call.operation, waypoints, None, controller)
        case figures:
            return PreviewRequest(call.operation, None, figures)


def motion_of(request: PreviewRequest) -> Motion:
    """Return the motion of a preview request.

    Raises:
        MalError: Invalid, the motion does not exist, or has other arguments.
    """
    declaration = _MOTIONS.get(request.operation)
    if declaration is None:
        raise _wrong(f"operation {request.operation[:64]!r}: one of {', '.join(_MOTIONS)}")
    waypoints, figures = request.waypoints or (), request.figures or ()
    arguments = declaration.arguments
    first = arguments[0]
    parts: tuple[Any, ...] = figures
    if first.kind is Waypoint:
        _require(declaration.operation, "figures", figures, ())
        if not first.repeated:
            _require(declaration.operation, "waypoints", waypoints, (first.name,))
        parts = (waypoints if first.repeated else waypoints[0], request.controller)
    else:
        if request.controller is not None:
            raise _wrong(f"controller: {declaration.operation} has none")
        _require(declaration.operation, "waypoints", waypoints, ())
        names = tuple(argument.name for argument in arguments)
        _require(declaration.operation, "figures", figures, names)
    motion = REQUESTS[declaration.service, declaration.operation](*parts)
    assert isinstance(motion, Motion)
    return motion


def wire_preview(preview: "Preview") -> types.Preview:
    """Return a preview for the wire."""
    clearance = preview.clearance
    return types.Preview(
        duration=preview.duration_s,
        length=preview.length_m,
        frame=FRAME,
        path=tuple(map(_pose, preview.path)),
        endUncertainty=preview.within_m,
        headingUncertainty=preview.within_rad,
        energy=preview.energy_j,
        clearance=None if clearance is None else clearance.least_m,
        nearest=None if clearance is None else clearance.obstacle,
        note=preview.note or None,
    )


MAX_STEPS: Final = 1000
"""Maximum number of steps in a preview: more would exceed a message."""


def wire_plan_preview(
    result: "Preview | Refusal", steps: Sequence["StepPreview"]
) -> types.PlanPreview:
    """Return the preview of a plan, or its refusal, with its steps for the wire."""
    return types.PlanPreview(
        total=None if isinstance(result, Refusal) else wire_preview(result),
        steps=tuple(map(_step, steps[:MAX_STEPS])),
        refusal=refusal_text(result) if isinstance(result, Refusal) else None,
    )


def refusal_text(refusal: Refusal) -> str:
    """Return a refusal with its number and name, for a peer that receives no report of it."""
    return f"{refusal.text} ({refusal.reason.value} {refusal.reason.name})"


def _step(step: "StepPreview") -> types.PreviewStep:
    near, refusal = step.clearance, step.refusal
    return types.PreviewStep(
        node=step.node,
        duration=step.duration_s,
        length=step.length_m,
        end=_pose(step.end),
        energy=step.energy_j,
        clearance=None if near is None else near.least_m,
        nearest=None if near is None else near.obstacle,
        refusal=None if refusal is None else refusal_text(refusal),
    )


def _pose(timed: "TimedPose") -> types.PreviewPose:
    pose = timed.pose
    return types.PreviewPose(time=timed.time_s, x=pose.x_m, y=pose.y_m, heading=pose.heading_rad)


def _require(operation: str, part: str, given: Sequence[object], wanted: Sequence[str]) -> None:
    if len(given) != len(wanted):
        named = f": {', '.join(wanted)}" if wanted else ""
        raise _wrong(f"{part}: {operation} has {len(wanted)}{named}; {len(given)} were given")


def _wrong(text: str) -> MalError:
    return with_text(AreaError.INVALID, text)
