"""`shortest_detour` past zones and rocks: a visibility graph, searched by A*.

Its nodes lie on a ring around each corner and rock. The radius of the ring is such that a straight
line between neighbours keeps the clearance. Lines are checked only when the search reaches them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count, islice
from math import cos, pi, sin
from typing import Final

from executive.obstacles.zones import (
    DISTANCE_RESOLUTION_M,
    KeepIn,
    KeepOut,
    KnownRock,
    Obstacle,
    Zones,
    has_clearance,
)
from executive.values.geometry import Point

NODES_PER_CORNER: Final = 12
"""Number of nodes around each corner and rock."""
MAX_COMPARISONS: Final = 20_000
"""Maximum number of rocks and zone sides checked, for nodes and again for lines. It bounds the
delay of a tick by a search, which may be several ticks among a hundred sides."""


@dataclass(frozen=True, slots=True)
class Detour:
    """Result of a search.

    Attributes:
        corners: points to pass in order before the end, on straight lines.
        reaches_goal: whether the last line to the end is free; if not, the last point is
            the nearest one found.
    """

    corners: tuple[Point, ...]
    reaches_goal: bool


def shortest_detour(
    start: Point, end: Point, zones: Zones, clearance_m: float, leads: Callable[[Point], bool]
) -> Detour:
    """Return the shortest path of straight lines.

    Args:
        start: its start.
        end: its end, which may be closer to obstacles than the clearance.
        zones: the obstacles.
        clearance_m: minimum distance of its lines from each obstacle, about the rover's centre.
            The first line, and the last near the end, are exempt.
        leads: whether the rover may drive straight to a point from the present position.
    """
    nodes = [end, *_nodes(zones, clearance_m)]
    obstacles = [(each, min(clearance_m, each.clearance_m(end, end))) for each in zones]
    before: dict[int, int | None] = {}
    order, left, sides = count(), MAX_COMPARISONS, sum(map(_sides, zones))
    queue: list[tuple[float, int, float, int, int | None]] = []

    def is_free(parent: int, index: int) -> bool:
        nonlocal left
        for number, (each, at_end_m) in enumerate(obstacles):
            left -= _sides(each)
            needed_m = clearance_m if index else at_end_m
            if not has_clearance(each, nodes[parent], nodes[index], needed_m):
                obstacles.insert(0, obstacles.pop(number))  # likely to block the next line, too
                return False
        return True

    def push_all(point: Point, walked_m: float, parent: int | None) -> None:
        for index, node in enumerate(nodes):
            if index not in before:
                distance_m = walked_m + point.distance_m(node)
                estimate_m = distance_m + node.distance_m(end)
                heappush(queue, (estimate_m, next(order), distance_m, index, parent))

    push_all(start, 0.0, None)
    while queue and left > 0:
        _, _, distance_m, index, parent = heappop(queue)
        if index in before:
            continue
        if parent is None:
            left -= sides
        if not (leads(nodes[index]) if parent is None else is_free(parent, index)):
            continue
        before[index] = parent
        if index == 0:
            return Detour(_through(nodes, before, parent), reaches_goal=True)
        push_all(nodes[index], distance_m, index)
    nearest = min(before, key=lambda index: nodes[index].distance_m(end), default=None)
    return Detour(_through(nodes, before, nearest), reaches_goal=False)


def _through(
    nodes: list[Point], before: dict[int, int | None], last: int | None
) -> tuple[Point, ...]:
    found: list[Point] = []
    while last is not None:
        found.append(nodes[last])
        last = before[last]
    return tuple(reversed(found))


def _nodes(zones: Zones, clearance_m: float) -> list[Point]:
    """Return the points of all rings that keep the clearance to every obstacle."""
    ring = [2 * pi * index / NODES_PER_CORNER for index in range(NODES_PER_CORNER)]
    found = (
        Point(centre.x_m + out_m * cos(angle_rad), centre.y_m + out_m * sin(angle_rad))
        for centre, radius_m in _centres(zones)
        for out_m in (
            (radius_m + clearance_m + DISTANCE_RESOLUTION_M) / cos(pi / NODES_PER_CORNER),
        )
        for angle_rad in ring
    )
    obstacles, found_free = list(zones), []
    for node in islice(found, MAX_COMPARISONS // max(1, sum(map(_sides, zones)))):
        for number, each in enumerate(obstacles):
            if not has_clearance(each, node, node, clearance_m):
                obstacles.insert(0, obstacles.pop(number))  # likely that of the next node, too
                break
        else:
            found_free.append(node)
    return found_free


def _sides(obstacle: Obstacle) -> int:
    return len(obstacle.corners_m) if isinstance(obstacle, KeepIn | KeepOut) else 1


def _centres(zones: Zones) -> Iterator[tuple[Point, float]]:
    """Yield the corners and rocks, and their radii."""
    for each in zones:
        if isinstance(each, KnownRock):
            yield Point(each.x_m, each.y_m), each.radius_m
    for area in (*zones.keep_out, *zones.keep_in):
        for corner in area.corners_m:
            yield Point(*corner), 0.0
