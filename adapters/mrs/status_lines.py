"""What stands first in `rover status`: what the rover is about, where it is, how it goes on."""

from itertools import chain
from math import degrees
from typing import TYPE_CHECKING

from adapters.mrs.types import AssetMode, AssetStatus, CameraState, PlanStatus, PlanUpdate

if TYPE_CHECKING:
    from adapters.mrs.client import MrsClient


async def suspended_plans(client: "MrsClient", mode: AssetMode) -> tuple[PlanUpdate, ...]:
    """Return the plans that wait to be resumed, if the rover stands; none where none are told."""
    from adapters.mal import MalError

    if mode not in {AssetMode.PAUSED, AssetMode.SAFE, AssetMode.STOPPED}:
        return ()
    try:
        plans = await client.get_plan_status()
    except MalError:  # of a rover that serves no plans; the rest of its status stands
        return ()
    return tuple(plan for plan in plans if plan.status is PlanStatus.SUSPENDED)


def work(status: AssetStatus) -> str:
    """Return what is under way, and what waits."""
    if status.activeCommandId is None and not status.queuedCommands:
        doing = "nothing under way, nothing waits"
    else:
        active = "none" if status.activeCommandId is None else str(status.activeCommandId)
        doing = f"command under way {active}, {status.queuedCommands} waiting"
    return doing if status.activePlan is None else f"{doing}, plan {status.activePlan}"


def place(values: dict[str, float | None], camera: CameraState) -> str:
    """Return where the rover is, and whether it films."""
    x, y, heading = values.get("POS_X"), values.get("POS_Y"), values.get("HEAD")
    video = f"video {'on' if camera.videoOn else 'off'}"
    if x is None or y is None or heading is None:
        return f"where it is, is not known now, {video}"
    return f"at x {x:z.2f} m, y {y:z.2f} m, heading {degrees(heading):z.1f}°, {video}"


def ways_out(mode: AssetMode, suspended: tuple[PlanUpdate, ...]) -> tuple[str, ...]:
    """Return why it stands, as far as its plans tell, and how it goes on; nothing if it does."""
    first: tuple[str, ...] = ()
    if mode is AssetMode.STOPPED:
        first = ("to go on: rover command resume",)
    if mode is AssetMode.SAFE:
        first = ("rover watch says why; to go on, when that is over: rover command resume",)
    plans = (
        (
            f"plan {plan.planId} is suspended: {plan.text}",
            f"to go on: rover plan resume {plan.planId}",
        )
        for plan in suspended
    )
    return (*first, *chain.from_iterable(plans))
