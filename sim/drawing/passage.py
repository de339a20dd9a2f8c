"""Draws a command's passage between ground, orbiter and rover, and the lengths of the queues."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from sim.drawing.lanes import (
    ENDED,
    ENDS,
    LEFT_PX,
    RECEIVED,
    SENT,
    STARTED,
    WAITING_FOR_TURN,
    WORK,
    Style,
    line,
    mark,
    write_beside,
)
from sim.drawing.style import COMMAND, DONE, FAINT, GRID, INK, POINT, WRONG

SHORT_S: Final = 0.4
"""Minimum drawn waiting time; a command of less duration is one mark."""
PASSAGE_PX: Final = 62
"""Height of a lane."""
QUEUE_PX: Final = 104
_GROUND, _ORBITER, _ROVER, _REPORT = 14, 29, 44, 54
"""Offsets of the levels of a lane from its top, in pixels."""
Levels = Sequence[tuple[float, int]]
"""Lengths of a queue, each with its start time."""
_STORED: Final = mark("o", 10, COMMAND)
_ON_GROUND: Final = mark("o", 10, DONE)
_LOST: Final = mark("x", 12, WRONG, markeredgecolor=WRONG, markeredgewidth=2.5)
_PATH_LINE: Final = line(COMMAND, 2)
_STORAGE: Final = line(COMMAND, 5)
_REPORTED: Final = line(DONE, 1.8)
LEGEND: Final[dict[str, list[Style]]] = {
    "sent from the ground": [SENT],
    "stored at the orbiter": [_STORED],
    "received aboard": [RECEIVED],
    "started": [STARTED],
    "executed, ended": [WORK, ENDED],
    "received on the ground": [_ON_GROUND],
}
LEGEND_OF_WAITING: Final[dict[str, list[Style]]] = {
    "queued at the orbiter": [_STORAGE],
    "expired there": [_LOST],
    "queued aboard": [WAITING_FOR_TURN],
    "report queued aboard": [_REPORTED],
}


@dataclass(frozen=True, slots=True)
class ReportTimes:
    """Times of a report: creation aboard and receipt on the ground."""

    made_s: float
    ground_s: float


@dataclass(frozen=True, slots=True)
class Passage:
    """A command sent over a link; times in seconds, as on the axis.

    Attributes:
        relayed: whether it was sent over the orbiter.
        ending: its ending; None before the end.
        stored_s: time of storage at the orbiter; None over the direct link.
        received, started, ended: reports of these stages; None without a report.
        lost_s: time of expiry at the orbiter.
        again: whether it was sent before; its execution is in the lane of the first transmission.
    """

    relayed: bool
    ending: str | None
    sent_s: float
    stored_s: float | None = None
    received: ReportTimes | None = None
    started: ReportTimes | None = None
    ended: ReportTimes | None = None
    lost_s: float | None = None
    again: bool = False

    @property
    def short(self) -> bool:
        """Whether its whole duration is below `SHORT_S`."""
        return self.ended is not None and self.ended.ground_s - self.sent_s < SHORT_S


def draw_passage(axes: Axes, lane: Passage, top: float) -> None:
    """Draw a lane of three levels; `top` is its upper edge in pixels, downwards."""
    link = "relay" if lane.relayed else "direct link"
    write_beside(axes, 46, top + 37, f"by {link}", fontsize=11 * POINT)
    ending, colour = lane.ending or "in progress", ENDS.get(lane.ending or "", FAINT)
    write_beside(axes, 132, top + 37, ending, color=colour, fontsize=11 * POINT)
    levels = {"ground": top + _GROUND, "orbiter": top + _ORBITER, "rover": top + _ROVER}
    if not lane.relayed:
        del levels["orbiter"]
    for name, y in levels.items():
        write_beside(axes, LEFT_PX - 8, y + 3, name, color=FAINT, fontsize=9 * POINT, ha="right")
        axes.axhline(y, color="#c9c9c9", linewidth=0.5, zorder=0.6)
    if lane.short:
        _draw_short(axes, lane, top)
        return
    _draw_uplink(axes, lane, top)
    if not lane.again:
        _draw_work(axes, lane, top + _ROVER)
    for passage in (lane.received, lane.started, lane.ended):
        if passage is not None:
            _draw_report(axes, passage, top)
    axes.plot(lane.sent_s, top + _GROUND, **SENT)


def _draw_short(axes: Axes, lane: Passage, top: float) -> None:
    """Draw a short command as one mark, with its duration as text."""
    assert lane.ended is not None
    ground, rover, sent_s = top + _GROUND, top + _ROVER, lane.sent_s
    axes.plot([sent_s, sent_s], [ground, rover], **_PATH_LINE)
    axes.plot(sent_s, ground, **SENT)
    if not lane.again:
        axes.plot(sent_s, rover, **RECEIVED)
    late = sent_s > 0.8 * axes.get_xlim()[1]
    axes.annotate(
        f"received after {lane.ended.ground_s - sent_s:.2f} s",
        (sent_s, ground),
        xytext=(-8 if late else 8, 0),
        textcoords="offset points",
        ha="right" if late else "left",
        va="center_baseline",
        color=DONE,
        fontsize=10 * POINT,
        bbox={"facecolor": "white", "linewidth": 0, "pad": 1},
    )


def _draw_uplink(axes: Axes, lane: Passage, top: float) -> None:
    """Draw a command from the ground to the rover, or to its expiry at the orbiter."""
    ground, orbiter, rover = top + _GROUND, top + _ORBITER, top + _ROVER
    arrived_s = lane.lost_s if lane.received is None else lane.received.made_s
    if lane.stored_s is None:
        if arrived_s is not None:
            axes.plot([lane.sent_s, arrived_s], [ground, rover], **_PATH_LINE)
    else:
        axes.plot([lane.sent_s, lane.sent_s], [ground, orbiter], **_PATH_LINE)
        if arrived_s is not None and arrived_s - lane.stored_s > SHORT_S:
            axes.plot([lane.sent_s, arrived_s], [orbiter, orbiter], **_STORAGE)
        if lane.lost_s is not None:
            axes.plot(lane.lost_s, orbiter, **_LOST)
        elif arrived_s is not None:
            axes.plot([arrived_s, arrived_s], [orbiter, rover], **_PATH_LINE)
        axes.plot(lane.sent_s, orbiter, **_STORED)
    if lane.received is not None:
        axes.plot(lane.received.made_s, rover, **RECEIVED)


def _draw_work(axes: Axes, lane: Passage, rover: float) -> None:
    """Draw waiting and execution of a command aboard."""
    received, started, ended = lane.received, lane.started, lane.ended
    if received is not None and started is not None and started.made_s - received.made_s > SHORT_S:
        axes.plot([received.made_s, started.made_s], [rover, rover], **WAITING_FOR_TURN)
    if started is not None and ended is not None:
        axes.plot([started.made_s, ended.made_s], [rover, rover], **WORK)
        axes.plot(ended.made_s, rover, **ENDED)
        axes.plot(started.made_s, rover, **STARTED)


def _draw_report(axes: Axes, passage: ReportTimes, top: float) -> None:
    """Draw a report from the rover to the ground, after its waiting aboard."""
    made_s, ground_s = passage.made_s, passage.ground_s
    ground, rover, report = top + _GROUND, top + _ROVER, top + _REPORT
    if ground_s - made_s > SHORT_S:
        axes.plot([made_s, made_s, ground_s], [rover, report, report], **_REPORTED)
        rover = report
    axes.plot([ground_s, ground_s], [rover, ground], **_REPORTED)
    axes.plot(ground_s, ground, **_ON_GROUND)


def draw_queues(axes: Axes, commands: Levels, reports: Levels) -> None:
    """Draw the numbers of bundles queued at the orbiter and of reports queued aboard."""
    maximum = max([1, *(number for _, number in (*commands, *reports))])
    axes.set_ylim(0, maximum * QUEUE_PX / (QUEUE_PX - 30))
    axes.set_yticks(MaxNLocator(5, integer=True).tick_values(0, maximum))
    axes.tick_params(axis="y", length=0, labelcolor=FAINT, labelsize=10 * POINT)
    axes.grid(axis="y", color=GRID)
    begin_s, end_s = axes.get_xlim()
    for levels, colour in ((reports, DONE), (commands, COMMAND)):
        steps = [(begin_s, 0), *levels]
        steps.append((end_s, steps[-1][1]))
        axes.step(*zip(*steps, strict=True), where="post", **line(colour, 2.5))
    named = (
        (34, "queued", INK),
        (54, "bundles at the orbiter", COMMAND),
        (72, "reports aboard", DONE),
    )
    for y, text, colour in named:
        write_beside(
            axes,
            46,
            axes.get_ylim()[1] * (1 - y / QUEUE_PX),
            text,
            color=colour,
            fontweight="bold",
        )
