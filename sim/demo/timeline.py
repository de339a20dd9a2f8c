"""The timeline of sessions: each command on its way between ground, orbiter and rover."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor
from typing import Final

from sim.demo.drawing import Anchor, Drawing, Label, Polyline, Spot, disc, polygon
from sim.demo.script import Ending, Link
from sim.demo.timeline_marks import (
    BUSY,
    GIVEN_UP,
    READY,
    TURN,
    UP,
    arrival,
    bar,
    beginning,
    cross,
    legend,
    sending,
)

LEFT, RIGHT, BOTTOM = 300, 36, 58
LIGHT_TOP: Final = 92
DARK_TOP: Final = 128
"""Where the lanes begin: an eclipse takes another row of the legend, and its name."""
WIDTH: Final = 1240
LANE: Final = 62
GROUND, ORBITER, ROVER, REPORT = 14, 29, 44, 54
"""Where the levels of a lane are, below its top."""
HEADING: Final = 30
QUEUE: Final = 104
TICKS: Final = 5
"""Numbers on the axis of what waits, above 0."""
SHORT_S: Final = 0.4
"""What waits for less does not wait."""
_TITLE: Final = 28
INK, FAINT, GRID, DARK = "#222222", "#777777", "#e4e4e4", "#dde1ed"
_COLOUR: Final = {
    Ending.EXECUTED: "#00845f",
    Ending.CANCELLED: "#a87400",
    Ending.REJECTED: "#a87400",
    Ending.DUPLICATE: "#a87400",
    Ending.FAILED: GIVEN_UP,
    Ending.EXPIRED: GIVEN_UP,
}


@dataclass(frozen=True, slots=True)
class Passage:
    """A report: when it was made aboard, and when it was told on the ground."""

    made_s: float
    told_s: float


@dataclass(frozen=True, slots=True)
class Lane:
    """One command; times in seconds, as on the axis.

    Attributes:
        stored_s: when the orbiter had it; None by the direct link.
        received, started, ended: the reports of these stages, as far as there were any.
        lost_s: when the orbiter gave it up.
        again: whether it was sent before: what the rover does is in the first one's lane.
    """

    title: str
    link: Link
    ending: Ending | None
    sent_s: float
    stored_s: float | None = None
    received: Passage | None = None
    started: Passage | None = None
    ended: Passage | None = None
    lost_s: float | None = None
    again: bool = False


@dataclass(frozen=True, slots=True)
class Rover:
    """The commands of one rover; the heading may be empty."""

    heading: str
    lanes: tuple[Lane, ...]


@dataclass(frozen=True, slots=True)
class Level:
    """How many wait from a time on."""

    from_s: float
    waiting: int


@dataclass(frozen=True, slots=True)
class Timeline:
    """What the picture shows.

    Attributes:
        eclipses: from when to when there was no contact.
        commands: how many bundles waited at the orbiter.
        reports: how many reports waited aboard.
    """

    title: str
    rovers: tuple[Rover, ...]
    eclipses: tuple[tuple[float, float], ...] = ()
    commands: tuple[Level, ...] = ()
    reports: tuple[Level, ...] = ()
    end_s: float = 0.0


class _Sheet:
    """The drawing, with a time axis."""

    def __init__(self, timeline: Timeline) -> None:
        self.end_s = timeline.end_s + 1.0
        lanes = sum(len(rover.lanes) for rover in timeline.rovers)
        headings = sum(bool(rover.heading) for rover in timeline.rovers)
        self.top = DARK_TOP if timeline.eclipses else LIGHT_TOP
        self.lanes_end = self.top + LANE * lanes + HEADING * headings
        self.bottom = self.lanes_end + (QUEUE if timeline.eclipses else 0)
        self.drawing = Drawing(WIDTH, self.bottom + BOTTOM)

    def x(self, at_s: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (at_s + 1.0) / (self.end_s + 1.0)


def draw_timeline(timeline: Timeline) -> Drawing:
    """Return the picture."""
    sheet = _Sheet(timeline)
    drawing = sheet.drawing
    _draw_eclipses(sheet, timeline.eclipses)
    _draw_axis(sheet)
    drawing.add(Label(timeline.title, (24, 36), 20, bold=True))
    drawing.add(*legend(24, 66, eclipse=bool(timeline.eclipses)))
    y = float(sheet.top)
    for rover in timeline.rovers:
        if rover.heading:
            drawing.add(Label(rover.heading, (24, y + 21), 15, bold=True))
            y += HEADING
        for number, lane in enumerate(rover.lanes, 1):
            _draw_lane(sheet, lane, number, y)
            y += LANE
    if timeline.eclipses:
        _draw_queues(sheet, timeline)
    return drawing


def _cut(words: str) -> str:
    return words if len(words) <= _TITLE else f"{words[: _TITLE - 1].rstrip('-., ')}…"


def _draw_eclipses(sheet: _Sheet, eclipses: Sequence[tuple[float, float]]) -> None:
    for begin_s, end_s in eclipses:
        west, east = sheet.x(max(begin_s, -1.0)), sheet.x(min(end_s, sheet.end_s))
        top, bottom = sheet.top - 22, sheet.bottom
        corners = ((west, top), (east, top), (east, bottom), (west, bottom))
        middle = ((west + east) / 2, sheet.top - 7)
        words = f"eclipse: no contact for {end_s - begin_s:.0f} s"
        sheet.drawing.add(
            polygon(*corners, fill=DARK),
            Label(words, middle, 13, "#3a4466", Anchor.MIDDLE, bold=True),
        )


def _draw_axis(sheet: _Sheet) -> None:
    step_s = 5 if sheet.end_s < 80 else 10
    for at_s in range(0, floor(sheet.end_s) + 1, step_s):
        x = sheet.x(at_s)
        sheet.drawing.add(
            Polyline(((x, sheet.top), (x, sheet.bottom + 5)), GRID),
            Label(str(at_s), (x, sheet.bottom + 20), 12, anchor=Anchor.MIDDLE),
        )
    middle = ((LEFT + WIDTH - RIGHT) / 2, sheet.bottom + 42)
    words = "seconds after the first command"
    sheet.drawing.add(
        Polyline(((LEFT, sheet.bottom), (WIDTH - RIGHT, sheet.bottom)), INK),
        Label(words, middle, anchor=Anchor.MIDDLE),
    )


def _draw_lane(sheet: _Sheet, lane: Lane, number: int, top: float) -> None:
    drawing = sheet.drawing
    ground, orbiter, rover = top + GROUND, top + ORBITER, top + ROVER
    title = _cut(f"again: {lane.title}" if lane.again else lane.title)
    ending = "under way" if lane.ending is None else lane.ending.value
    colour = FAINT if lane.ending is None else _COLOUR[lane.ending]
    drawing.add(
        Polyline(((24, top), (WIDTH - RIGHT, top)), "#cfcfcf"),
        Label(str(number), (36, top + 27), 13, FAINT, Anchor.END),
        Label(title, (46, top + 27), 13, bold=True),
        Label(f"by {'relay' if lane.link is Link.RELAY else 'direct link'}", (46, top + 45), 12),
        Label(ending, (132, top + 45), 12, colour, bold=True),
    )
    for name, y in (("ground", ground), ("orbiter", orbiter), ("rover", rover)):
        if name == "orbiter" and lane.link is Link.DIRECT:
            continue
        drawing.add(
            Label(name, (LEFT - 8, y + 3), 10, FAINT, Anchor.END),
            Polyline(((LEFT, y), (WIDTH - RIGHT, y)), "#c9c9c9", 0.6),
        )
    _draw_way_up(sheet, lane, ground, orbiter, rover)
    if not lane.again:
        _draw_work(sheet, lane, rover)
    for passage in (lane.received, lane.started, lane.ended):
        if passage is not None:
            _draw_report(sheet, passage, ground, rover, top + REPORT)
    drawing.add(*sending((sheet.x(lane.sent_s), ground)))


def _draw_way_up(sheet: _Sheet, lane: Lane, ground: float, orbiter: float, rover: float) -> None:
    """Draw a command from the ground to the rover, or to where it was given up."""
    drawing, sent = sheet.drawing, sheet.x(lane.sent_s)
    arrived_s = lane.lost_s if lane.received is None else lane.received.made_s
    if lane.stored_s is None:
        if arrived_s is not None:
            drawing.add(Polyline(((sent, ground), (sheet.x(arrived_s), rover)), UP, 2))
    else:
        drawing.add(Polyline(((sent, ground), (sent, orbiter)), UP, 2))
        if arrived_s is not None:
            arrived = sheet.x(arrived_s)
            if arrived_s - lane.stored_s > SHORT_S:
                drawing.add(Polyline(((sent, orbiter), (arrived, orbiter)), UP, 5))
            if lane.lost_s is None:
                drawing.add(Polyline(((arrived, orbiter), (arrived, rover)), UP, 2))
            else:
                drawing.add(*cross((arrived, orbiter)))
        drawing.add(disc((sent, orbiter), 4.5, UP, "#ffffff", 1))
    if lane.received is not None:
        drawing.add(*arrival((sheet.x(lane.received.made_s), rover)))


def _draw_work(sheet: _Sheet, lane: Lane, rover: float) -> None:
    """Draw how long a command waited aboard, and was carried out."""
    received, started, ended = lane.received, lane.started, lane.ended
    if received is not None and started is not None and started.made_s - received.made_s > SHORT_S:
        spots = ((sheet.x(received.made_s), rover), (sheet.x(started.made_s), rover))
        sheet.drawing.add(Polyline(spots, BUSY, 2, dash=TURN))
    if started is not None and ended is not None:
        sheet.drawing.add(*bar((sheet.x(started.made_s), rover), sheet.x(ended.made_s)))
        sheet.drawing.add(*beginning((sheet.x(started.made_s), rover)))


def _draw_report(
    sheet: _Sheet, passage: Passage, ground: float, rover: float, report: float
) -> None:
    """Draw a report from the rover to the ground, after it waited aboard."""
    made, told = sheet.x(passage.made_s), sheet.x(passage.told_s)
    spots: tuple[Spot, ...] = ((told, rover), (told, ground))
    if passage.told_s - passage.made_s > SHORT_S:
        spots = ((made, rover), (made, report), (told, report), (told, ground))
    sheet.drawing.add(Polyline(spots, READY, 1.8), disc((told, ground), 4.5, READY, "#ffffff", 1))


def _ticks(most: int) -> list[int]:
    """Return whole numbers from 0 to the most, as many as there is room for."""
    step = ceil(most / TICKS)
    return [*(tick for tick in range(0, most, step) if most - tick >= step), most]


def _draw_queues(sheet: _Sheet, timeline: Timeline) -> None:
    drawing, top, base = sheet.drawing, sheet.lanes_end, sheet.bottom
    levels = (*timeline.commands, *timeline.reports)
    most = max([1, *(level.waiting for level in levels)])
    height = QUEUE - 30
    drawing.add(Polyline(((24, top), (WIDTH - RIGHT, top)), "#cfcfcf"))
    for waiting in _ticks(most):
        y = base - height * waiting / most
        drawing.add(
            Label(str(waiting), (LEFT - 8, y + 4), 11, FAINT, Anchor.END),
            Polyline(((LEFT, y), (WIDTH - RIGHT, y)), GRID),
        )
    for levels, colour in ((timeline.reports, READY), (timeline.commands, UP)):
        spots: list[Spot] = [(LEFT, base)]
        for level in levels:
            x = max(LEFT, sheet.x(level.from_s))
            spots += [(x, spots[-1][1]), (x, base - height * level.waiting / most)]
        spots.append((WIDTH - RIGHT, spots[-1][1]))
        drawing.add(Polyline(tuple(spots), colour, 2.5))
    drawing.add(
        Label("waiting", (46, top + 34), 13, bold=True),
        Label("bundles at the orbiter", (46, top + 54), 12, UP, bold=True),
        Label("reports aboard", (46, top + 72), 12, READY, bold=True),
    )
