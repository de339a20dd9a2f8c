"""Who else conducts a day: a script that knows all, over a direct link, and fixed lists."""

import asyncio
from collections.abc import Iterator
from math import hypot
from typing import Final

from adapters.mrs.ground import MrsClient
from executive.commands import (
    MoveTo,
    PlanDefinition,
    Request,
    Resume,
    SetCameraAngles,
    SetStatusInterval,
    SetTravelSpeed,
    TakePicture,
    Waypoint,
)
from executive.values.geometry import Point
from executive.values.reports import Stage
from tests.simulated.day import LEAD_S, PANORAMA, Day, DayScene, Pass, Site, connect
from tests.simulated.process import Process

SPEED_MPS: Final = 0.5
OFTEN_S: Final = 5.0
SELDOM_S: Final = 60.0
_BESIDE_M: Final = 1.1
_ROVER_M: Final = 0.55
"""What a rover needs between its centre and an obstacle."""
_ATTEMPTS: Final = 8
_AFTER_DAWN_S: Final = 1200.0
_TURNS_S: Final = 6.0
_PICTURE_S: Final = 3.0
_LATE_S: Final = 150.0


class Foreknowing:
    """A script that knows obstacles, fault and link of a day, and commands over a direct link."""

    def __init__(self, scene: DayScene) -> None:
        self._scene, self._day = scene, scene.day

    def start(self, process: Process) -> None:
        """Command the day; the `start` of a process."""
        process.run(self._conduct(process))

    async def _conduct(self, process: Process) -> None:
        self._client = await connect(self._scene.direct_uri, process)
        day = self._day
        async with asyncio.TaskGroup() as tasks:
            for each in day.passes:
                tasks.create_task(self._serve(each))
            await self._until(0.0)
            await self._run(SetTravelSpeed(SPEED_MPS))
            for site in day.sites:
                if not site.morning:
                    await self._visit(site)
            await self._go_home()
            await self._run(SetCameraAngles(0.0, 0.0))
            await self._until(day.sunrise_s + min(_AFTER_DAWN_S, day.end_s - day.sunrise_s) / 2)
            for site in day.sites:
                if site.morning:
                    await self._visit(site)
            await self._go_home()

    async def _serve(self, each: Pass) -> None:
        """Take a picture in a pass, and have status sent often."""
        if each.opens_s is None:
            return
        await self._until(each.opens_s)
        await self._run(SetStatusInterval(OFTEN_S))
        await self._insist(TakePicture())
        await self._until(each.end_s)
        await self._run(SetStatusInterval(SELDOM_S))

    async def _visit(self, site: Site) -> None:
        for viewpoint in viewpoints(self._day, site):
            if await self._insist(MoveTo(Waypoint(viewpoint.x_m, viewpoint.y_m))):
                break
        for pan_rad in PANORAMA if site.panorama else (0.0,):
            await self._insist(SetCameraAngles(pan_rad, -0.1))
            await self._insist(TakePicture())

    async def _go_home(self) -> None:
        await self._insist(MoveTo(Waypoint(0.0, 0.0)))

    async def _insist(self, request: Request) -> bool:
        """Command it until it is executed; wait for the end of the fault, of which it knows."""
        for _ in range(_ATTEMPTS):
            if await self._run(request):
                return True
            ends_s = self._scene.fault_ends_s
            if ends_s is not None:
                await self._until(ends_s + 1.0)
            await self._run(Resume())
        return False

    async def _run(self, request: Request) -> bool:
        outcome = await self._client.run(self._client.command(request))
        return outcome.stage is Stage.EXECUTED

    async def _until(self, at_s: float) -> None:
        left_s = LEAD_S + at_s - asyncio.get_running_loop().time()
        if left_s > 0.0:
            await asyncio.sleep(left_s)

    _client: MrsClient


def viewpoints(day: Day, site: Site) -> list[Point]:
    """Return the free positions from which a site can be photographed, best first."""
    sides = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
    points = (Point(site.x_m + _BESIDE_M * x, site.y_m + _BESIDE_M * y) for x, y in sides)
    return [each for each in points if is_free(day, each)]


def is_free(day: Day, point: Point) -> bool:
    """Return whether a rover can stand at a point."""
    rocks = all(
        hypot(point.x_m - rock.x_m, point.y_m - rock.y_m) > rock.radius_m + _ROVER_M
        for rock in day.rocks
    )
    walls = all(wall.area.distance_m(point.x_m, point.y_m) > _ROVER_M for wall in day.walls)
    return rocks and walls


def fixed_list(day: Day, *, ignores_failures: bool) -> PlanDefinition:
    """Return the day as a fixed list: one step after the other, pauses by nominal durations.

    Args:
        day: whose sites and planned passes are known.
        ignores_failures: whether a step that fails is passed over; else it ends the list.
    """
    steps = "\n".join(
        f"<ForceSuccess>{step}</ForceSuccess>" if ignores_failures else step for step in _steps(day)
    )
    text = (
        '<root BTCPP_format="4"><BehaviorTree ID="List">'
        f"<Sequence>\n{steps}\n</Sequence></BehaviorTree></root>"
    )
    return PlanDefinition("list", "list", "BTCPP4", text.encode())


def _steps(day: Day) -> Iterator[str]:
    """Yield the steps of a fixed list in their order."""
    at_s, here = 30.0, Point(0.0, 0.0)
    passes = list(day.passes)
    yield f'<setTravelSpeed speed="{SPEED_MPS}" deadline_s="5"/>'

    def serve(until_s: float) -> Iterator[str]:
        """Yield what is done in the passes that begin before a time."""
        nonlocal at_s
        while passes and passes[0].begin_s <= until_s:
            each = passes.pop(0)
            late_s = min(_LATE_S, (each.end_s - each.begin_s) / 4)
            yield from sleep(each.begin_s + late_s)
            yield f'<setStatusInterval interval="{OFTEN_S}" deadline_s="5"/>'
            yield '<takePicture deadline_s="20"/>'
            yield from sleep(each.end_s)
            yield f'<setStatusInterval interval="{SELDOM_S}" deadline_s="5"/>'

    def sleep(until_s: float) -> Iterator[str]:
        nonlocal at_s
        if until_s > at_s:
            yield f'<Sleep msec="{round(1000 * (until_s - at_s))}"/>'
            at_s = until_s

    def drive(x_m: float, y_m: float) -> Iterator[str]:
        nonlocal at_s, here
        yield f'<moveTo x="{x_m}" y="{y_m}" deadline_s="240"/>'
        at_s += here.distance_m(Point(x_m, y_m)) / SPEED_MPS + _TURNS_S
        here = Point(x_m, y_m)

    by_day = [site for site in day.sites if not site.morning]
    span_s = day.sunset_s / (len(by_day) + 1)
    yield from serve(0.0)
    for number, site in enumerate(by_day):
        yield from serve(span_s * number)
        yield from drive(site.x_m, site.y_m)
        for pan_rad in PANORAMA if site.panorama else (0.0,):
            yield f'<setCameraAngles pan="{pan_rad}" tilt="-0.1" deadline_s="15"/>'
            yield '<takePicture deadline_s="20"/>'
            at_s += _PICTURE_S
    yield from drive(0.0, 0.0)
    yield from serve(day.sunrise_s)
    yield from sleep(day.sunrise_s + min(_AFTER_DAWN_S, day.end_s - day.sunrise_s) / 2)
    for site in day.sites:
        if site.morning:
            yield from drive(site.x_m, site.y_m)
            for pan_rad in PANORAMA if site.panorama else (0.0,):
                yield f'<setCameraAngles pan="{pan_rad}" tilt="-0.1" deadline_s="15"/>'
                yield '<takePicture deadline_s="20"/>'
    yield from drive(0.0, 0.0)
    yield from serve(day.end_s)
