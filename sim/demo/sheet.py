"""A window of the ground on paper: soil with lines of equal height, rocks, axes, scale."""

from collections.abc import Sequence
from math import ceil, cos, floor, pi, sin
from random import Random
from typing import Final

from executive.geometry import Point
from sim.demo.contours import contour
from sim.demo.drawing import Anchor, Drawing, Label, Polyline, Spot, polygon
from sim.rover import CELL_M, Rock, World, make_terrain

PIXELS_PER_M: Final = 100
MARGIN_M: Final = 0.9
SMALLEST_M: Final = 4.2
"""Side of the window at least, so that there is room for a legend beside it."""
CONTOUR_M: Final = 0.01
LEFT, TOP, RIGHT, BOTTOM = 62, 52, 262, 56
SOIL, SOIL_LINE = "#f7f1e8", "#e3d4c0"
ROCK, ROCK_LINE = "#b8ab9d", "#80746a"
INK, FAINT = "#222222", "#777777"


class Sheet:
    """A drawing with the ground of a world on it, room for a title above and a legend beside it.

    Attributes:
        drawing: what is drawn so far.
        right, bottom: where the window ends on the drawing, in pixels.
    """

    def __init__(self, world: World, places: Sequence[Point]) -> None:
        """Draw the ground around places."""
        self._west_m, self._east_m = _span([place.x_m for place in places])
        self._south_m, self._north_m = _span([place.y_m for place in places])
        self.right = LEFT + PIXELS_PER_M * (self._east_m - self._west_m)
        self.bottom = TOP + PIXELS_PER_M * (self._north_m - self._south_m)
        self.drawing = Drawing(round(self.right) + RIGHT, round(self.bottom) + BOTTOM)
        self._draw_soil(world)
        for number, rock in enumerate(world.all_rocks):
            if self._shows(rock.x_m, rock.y_m, rock.radius_m):
                self._draw_rock(rock, number)

    def spot(self, place: Point) -> Spot:
        """Return where a place is on the drawing."""
        return (
            LEFT + PIXELS_PER_M * (place.x_m - self._west_m),
            self.bottom - PIXELS_PER_M * (place.y_m - self._south_m),
        )

    def frame(self) -> None:
        """Cut off what reaches beyond the window, and draw its axes and the scale."""
        left, top, right, bottom = LEFT, TOP, self.right, self.bottom
        width, height = self.drawing.width, self.drawing.height
        for west, north, east, south in (
            (0, 0, left, height),
            (0, 0, width, top),
            (right, 0, width, height),
            (0, bottom, width, height),
        ):
            self.drawing.add(
                polygon((west, north), (east, north), (east, south), (west, south), fill="#ffffff")
            )
        window = ((left, top), (right, top), (right, bottom), (left, bottom))
        self.drawing.add(polygon(*window, fill=None, stroke=INK))
        for x_m in range(ceil(self._west_m), floor(self._east_m) + 1):
            x, _ = self.spot(Point(x_m, 0))
            self.drawing.add(
                Polyline(((x, bottom), (x, bottom + 5)), INK),
                Label(str(x_m), (x, bottom + 20), 12, anchor=Anchor.MIDDLE),
            )
        for y_m in range(ceil(self._south_m), floor(self._north_m) + 1):
            _, y = self.spot(Point(0, y_m))
            self.drawing.add(
                Polyline(((left, y), (left - 5, y)), INK),
                Label(str(y_m), (left - 10, y + 4), 12, anchor=Anchor.END),
            )
        middle = (left + right) / 2
        self.drawing.add(
            Label("x in m", (middle, bottom + 42), anchor=Anchor.MIDDLE),
            Label("y in m", (left - 52, top + 14)),
        )
        self._draw_scale()

    def _draw_scale(self) -> None:
        west, south = LEFT + 16, self.bottom - 16
        east = west + PIXELS_PER_M
        self.drawing.add(
            Polyline(((west, south - 6), (west, south), (east, south), (east, south - 6)), INK, 2),
            Label("1 m", ((west + east) / 2, south - 5), 12, anchor=Anchor.MIDDLE),
        )

    def _draw_soil(self, world: World) -> None:
        corners = ((0, 0), (self.drawing.width, 0), (self.drawing.width, self.drawing.height))
        self.drawing.add(polygon(*corners, (0, self.drawing.height), fill=SOIL))
        if world.ground.amplitude_m == 0:
            return
        terrain = make_terrain(world.ground)
        for level in range(1, ceil(world.ground.amplitude_m / CONTOUR_M)):
            for start, end in contour(terrain, level * CONTOUR_M):
                if self._shows(start.x_m, start.y_m, CELL_M):
                    self.drawing.add(Polyline((self.spot(start), self.spot(end)), SOIL_LINE, 1.2))

    def _draw_rock(self, rock: Rock, number: int) -> None:
        random = Random(number)
        corners = max(7, min(13, round(30 * rock.radius_m)))
        spots = []
        for corner in range(corners):
            angle_rad = 2 * pi * (corner + random.uniform(-0.25, 0.25)) / corners
            radius_m = rock.radius_m * random.uniform(0.86, 1.0)
            place = Point(
                rock.x_m + radius_m * cos(angle_rad), rock.y_m + radius_m * sin(angle_rad)
            )
            spots.append(self.spot(place))
        self.drawing.add(polygon(*spots, fill=ROCK, stroke=ROCK_LINE, width=1.5))

    def _shows(self, x_m: float, y_m: float, around_m: float = 0.0) -> bool:
        return (
            self._west_m - around_m < x_m < self._east_m + around_m
            and self._south_m - around_m < y_m < self._north_m + around_m
        )


def _span(places_m: Sequence[float]) -> tuple[float, float]:
    """Return from where to where a window reaches that shows all places."""
    low_m, high_m = min(places_m) - MARGIN_M, max(places_m) + MARGIN_M
    more_m = max(0.0, SMALLEST_M - (high_m - low_m)) / 2
    return low_m - more_m, high_m + more_m
