"""`search_detour` past zones and rocks: a visibility graph, searched by A*, in slices.

Its nodes lie on a ring around each corner and rock. The radius of the ring is such that a straight
line between neighbours keeps the clearance. Lines are checked only when the search reaches them.

A search among a hundred sides takes longer than a tick. `Detours` advances it by a number of
comparisons in each turn of the core, never by a time, so that runs repeat bit for bit.
"""

from collections.abc import Callable, Generator, Hashable, Iterator
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import islice
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
"""Maximum number of rocks and zone sides checked, for nodes and again for lines."""
SLICE_COMPARISONS: Final = 500
"""Number of comparisons in a slice, one or two milliseconds."""
LINES_PER_LEG: Final = 3
"""Maximum number of lines of a straight drive with its turns: those of the control point."""
MAX_SEARCHES: Final = 16
"""Maximum number of stored searches: of the queued motions, and of the return home."""


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


DetourSearch = Generator[int, None, Detour]
"""A search in small steps; yields the number of comparisons of each."""


class Detours:
    """The detours of one asset, searched in slices on the thread that owns them.

    Attributes:
        undecided: whether a request had no result yet; reset by the caller.
    """

    def __init__(self, first_slice: float = SLICE_COMPARISONS) -> None:
        self._found: dict[Hashable, Detour | DetourSearch] = {}
        self._left = first_slice
        self.undecided = False

    def copy(self) -> "Detours":
        """Return detours with the same results, for a preview."""
        copied = Detours()
        copied._found = {key: at for key, at in self._found.items() if isinstance(at, Detour)}
        return copied

    @property
    def searched(self) -> bool:
        """Whether comparisons were made since the last `advance`, or in it."""
        return self._left < SLICE_COMPARISONS

    def find(self, key: Hashable, begin: Callable[[], DetourSearch]) -> Detour | None:
        """Return the result of a search, begun if its key is new; None until it is found."""
        self._found[key] = self._found.pop(key) if key in self._found else begin()
        if len(self._found) > MAX_SEARCHES:
            del self._found[next(iter(self._found))]
        found = self._advance(key)
        self.undecided |= found is None
        return found

    def advance(self) -> bool:
        """Advance the newest unfinished search by a slice; return whether one is unfinished."""
        self._left = SLICE_COMPARISONS
        unfinished = [key for key, each in self._found.items() if not isinstance(each, Detour)]
        if unfinished and self._advance(unfinished[-1]) is not None:
            unfinished.pop()
        return bool(unfinished)

    def _advance(self, key: Hashable) -> Detour | None:
        search = self._found[key]
        if isinstance(search, Detour):
            return search
        try:
            while self._left > 0:
                self._left -= next(search)
        except StopIteration as end:
            found: Detour = end.value
            self._found[key] = found
            return found
        return None


Scene = tuple[Zones, Detours | None]
"""Obstacles, and the detours around them; without these each search runs to its end."""

_Line = tuple[float, int, int, float, int | None]
"""Length of the shortest path by a line, order of its node, index of its end, length up to that,
and index of the node."""


def search_detour(
    start: Point, end: Point, zones: Zones, clearance_m: float, leads: Callable[[Point], bool]
) -> DetourSearch:
    """Search the shortest path of straight lines.

    Args:
        start: its start.
        end: its end, which may be closer to obstacles than the clearance.
        zones: the obstacles.
        clearance_m: minimum distance of its lines from each obstacle, about the rover's centre.
            The first line, and the last near the end, are exempt.
        leads: whether the rover may drive straight to a point from the present position.
    """
    nodes = [end, *(yield from _nodes(zones, clearance_m))]
    obstacles: list[tuple[Obstacle, float]] = []
    for each in zones:
        far = has_clearance(each, end, end, clearance_m)
        obstacles.append((each, clearance_m if far else each.clearance_m(end, end)))
    before: dict[int, int | None] = {}
    left, sides = MAX_COMPARISONS, sum(map(_sides, zones))
    to_end_m = [each.distance_m(end) for each in nodes]
    queue: list[tuple[_Line, Iterator[_Line]]] = []

    def is_free(parent: int, index: int) -> bool:
        nonlocal left
        for number, (each, at_end_m) in enumerate(obstacles):
            left -= _sides(each)
            needed_m = clearance_m if index else at_end_m
            if not has_clearance(each, nodes[parent], nodes[index], needed_m):
                obstacles.insert(0, obstacles.pop(number))  # likely to block the next line, too
                return False
        return True

    def lines(point: Point, walked_m: float, parent: int | None) -> Iterator[_Line]:
        """Yield the lines from a node, the best first."""

        def through_m(index: int) -> float:
            return walked_m + point.distance_m(nodes[index])

        order, others = len(before), (each for each in range(len(nodes)) if each not in before)
        for index in sorted(others, key=lambda each: through_m(each) + to_end_m[each]):
            distance_m = through_m(index)
            yield distance_m + to_end_m[index], order, index, distance_m, parent

    def push_next(branch: Iterator[_Line]) -> None:
        if (line := next(branch, None)) is not None:
            heappush(queue, (line, branch))

    push_next(lines(start, 0.0, None))
    while queue and left > 0:
        (_, _, index, distance_m, parent), branch = heappop(queue)
        push_next(branch)
        if index in before:
            yield 1
            continue
        if parent is None:
            left -= sides
            free = leads(nodes[index])
            yield LINES_PER_LEG * sides
        else:
            left_before = left
            free = is_free(parent, index)
            yield left_before - left
        if not free:
            continue
        before[index] = parent
        if index == 0:
            break
        push_next(lines(nodes[index], distance_m, index))
        yield len(nodes)
    if 0 in before:
        return Detour(_through(nodes, before, before[0]), reaches_goal=True)
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


def _nodes(zones: Zones, clearance_m: float) -> Generator[int, None, list[Point]]:
    """Return the points of all rings with the clearance to every obstacle, in steps."""
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
    sides = sum(map(_sides, zones))
    for node in islice(found, MAX_COMPARISONS // max(1, sides)):
        for number, each in enumerate(obstacles):
            if not has_clearance(each, node, node, clearance_m):
                obstacles.insert(0, obstacles.pop(number))  # likely that of the next node, too
                break
        else:
            found_free.append(node)
        yield sides
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
