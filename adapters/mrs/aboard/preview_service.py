"""`PreviewService`: previews of motions and plans, computed in slices on the link's loop.

A slice holds Python's interpreter lock for well under a millisecond, and the loop sleeps after it.
So the core's thread meets its ticks, and a stop is served during a preview.
"""

import asyncio
from collections.abc import Sequence
from typing import Final

from adapters.mal import CallContext, MalError
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import CoreGateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import (
    AreaError,
    PreviewRequest,
    framed,
    motion_of,
    refusal_text,
    wire_plan_preview,
    wire_preview,
    with_text,
)
from executive.commands import Motion, PlanDefinition
from executive.preview import Preview, PreviewRun, StepPreview
from executive.values.reasons import Refusal

SLICE_TICKS: Final = 2
PAUSE_S: Final = 0.0005
MAX_CONCURRENT: Final = 2
MAX_PREVIEW_S: Final = 60.0
"""Timeout of a preview, e.g. if the trajectory solver does not answer; chosen, not measured."""


class PreviewService:
    """Serves `MotionControl.preview` and those of `Plan`, `MAX_CONCURRENT` at a time."""

    def __init__(self, served: ServedOperations, gateway: CoreGateway) -> None:
        self._gateway = gateway
        self._running = 0
        served.serve("MotionControl", "preview", self._motion)
        served.serve("Plan", "previewPlan", self._preview_plan)
        served.serve("Plan", "previewSteps", self._preview_steps)

    async def _motion(
        self,
        call: CallContext,
        operation: str,
        waypoints: tuple[wire.Waypoint, ...] | None,
        figures: tuple[float, ...] | None,
        controller: wire.Controller | None,
    ) -> tuple[wire.Preview]:
        request = PreviewRequest(operation, waypoints, figures, controller)
        return (await self._work_out(framed(motion_of(request), call.supplements)),)

    async def _preview_plan(self, _: CallContext, plan: wire.PlanDefinition) -> tuple[wire.Preview]:
        return (await self._work_out(wire.definition_of(plan)),)

    async def _preview_steps(
        self, _: CallContext, plan: wire.PlanDefinition
    ) -> tuple[wire.PlanPreview]:
        result, steps = await self._run(wire.definition_of(plan))
        if isinstance(result, Refusal) and _error_of(result) is AreaError.INVALID and not steps:
            raise _refusal_error(result)
        return (wire_plan_preview(result, steps),)

    async def _work_out(self, request: Motion | PlanDefinition) -> wire.Preview:
        result, _ = await self._run(request)
        if isinstance(result, Refusal):
            raise _refusal_error(result)
        return wire_preview(result)

    async def _run(
        self, request: Motion | PlanDefinition
    ) -> tuple[Preview | Refusal, Sequence[StepPreview]]:
        if self._running >= MAX_CONCURRENT:
            raise with_text(AreaError.BUSY, f"{MAX_CONCURRENT} previews are running: try again")
        self._running += 1
        try:
            run = await self._gateway.query(lambda executive: executive.preview(request))
            if isinstance(run, Refusal):
                return run, ()
            return await _run_in_slices(run), run.steps
        finally:
            self._running -= 1


async def _run_in_slices(run: PreviewRun) -> Preview | Refusal:
    run.set_up()
    try:
        async with asyncio.timeout(MAX_PREVIEW_S):
            while run.result is None:
                await asyncio.sleep(PAUSE_S)
                run.advance(SLICE_TICKS)
    except TimeoutError:
        text = f"the preview was not computed within {MAX_PREVIEW_S:g} s: preview it in parts"
        raise with_text(AreaError.BUSY, text) from None
    return run.result


def _refusal_error(refusal: Refusal) -> MalError:
    """Return the error for a refusal, with its full text: no report follows."""
    return with_text(_error_of(refusal), refusal_text(refusal))


def _error_of(refusal: Refusal) -> AreaError:
    return _ERRORS.get(refusal.reason.value // 100, AreaError.REJECTED)


_ERRORS: Final = {1: AreaError.INVALID, 4: AreaError.NOT_SUPPORTED}
"""Errors by block of the reason number; Rejected for all other blocks."""
