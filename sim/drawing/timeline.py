"""`draw_timeline` of a run: life cycles of commands, faults, events, modes, the true speed.

With an orbiter each command has a lane of three levels: ground, orbiter, rover.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from executive.commands import Mode
from executive.history import CommandHistory
from executive.values.reports import Report, ReportKind, Stage
from sim.drawing.lanes import (
    ENDED,
    ENDS,
    LEFT_PX,
    RECEIVED,
    RIGHT_PX,
    SENT,
    STARTED,
    WAITING_FOR_TURN,
    WIDTH_PX,
    WORK,
    Panel,
    Style,
    add_legend_row,
    draw_panel,
    draw_rule,
    line,
    mark,
    write_beside,
)
from sim.drawing.passage import (
    LEGEND,
    LEGEND_OF_WAITING,
    PASSAGE_PX,
    QUEUE_PX,
    Levels,
    Passage,
    draw_passage,
    draw_queues,
)
from sim.drawing.style import FAINT, GRID, INK, POINT, WARNED, WRONG, styled_figure

MIN_DRAWN_WAIT_S: Final = 0.2
"""Minimum drawn waiting time aboard."""
_TOP, _BOTTOM = 84, 52
_LEGEND_ROW: Final = 22
LANE_PX, ROW_PX, _GAP, _PANEL = 40, 26, 12, 150
_TITLE: Final = 30
_MODES: Final = {
    Mode.IDLE: "#dcdcdc",
    Mode.MOVING: "#8fc1e3",
    Mode.TELEOP: "#c3dcef",
    Mode.PLAN: "#9ad3c0",
    Mode.PAUSED: "#f0d9a0",
    Mode.STOPPED: "#f2b8a0",
    Mode.SAFE: "#e58a7a",
}
DARK, _DARK_INK = "#dde1ed", "#3a4466"
EVENT: Final = mark("D", 9, WARNED)
_FAULT: Final = line(WRONG, 9, alpha=0.75)


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """A fault, a crash or a cargo with its interval; times in seconds, as all here."""

    name: str
    begin_s: float
    end_s: float


@dataclass(frozen=True, slots=True)
class CommandLane:
    """Data of one command's lane.

    Attributes:
        sent_s: times of the first and each further transmission.
        received_s, started_s, ended_s: times of the reports of these stages, if any.
        last: last reported stage.
        text: text about its end.
        figures: text beside the mark of its end.
        passage: path of the command over the drawn links.
    """

    title: str
    sent_s: tuple[float, ...]
    received_s: float | None = None
    started_s: float | None = None
    ended_s: float | None = None
    last: Stage | None = None
    text: str = ""
    figures: str = ""
    passage: Passage | None = None

    @property
    def height_px(self) -> int:
        """Height of the lane in pixels."""
        return LANE_PX if self.passage is None else PASSAGE_PX


def lane_of(
    entry: CommandHistory | None,
    time_of: Callable[[Report], float],
    title: str,
    sent_s: Sequence[float],
    unreported: str = "",
) -> CommandLane:
    """Return the lane of a command.

    Args:
        entry: history of the command; None without reports.
        time_of: returns the time of a report on the axis.
        title: name of the lane.
        sent_s: times of the first and each further transmission.
        unreported: text of a command without reports.
    """
    if entry is None:
        return CommandLane(title, tuple(sent_s), text=unreported)

    def when(stage: Stage) -> float | None:
        report = entry.report_at(stage)
        return None if report is None else time_of(report)

    end = entry.end
    last = end or entry.stages[-1]
    return CommandLane(
        title=title,
        sent_s=tuple(sent_s),
        received_s=when(Stage.RECEIVED),
        started_s=when(Stage.STARTED),
        ended_s=None if end is None else time_of(end),
        last=last.stage,
        text="" if last.reason is None else last.reason.name,
    )


def events_of(
    reports: Iterable[Report], time_of: Callable[[Report], float]
) -> tuple[tuple[str, tuple[float, ...]], ...]:
    """Return the name and times of each kind of event among reports."""
    events: dict[str, list[float]] = {}
    for report in reports:
        if report.kind is ReportKind.EVENT and report.identity is None:  # else a prediction
            name = report.text if report.reason is None else report.reason.name
            events.setdefault(name, []).append(time_of(report))
    return tuple((name, tuple(times_s)) for name, times_s in events.items())


@dataclass(frozen=True, slots=True)
class RunTimeline:
    """Data of a timeline.

    Attributes:
        end_s: duration of the run.
        faults: faults, crashes and cargo.
        events: name and times of each kind of reported event.
        modes: modes with begin and end.
        panels: panels of speeds below the rows.
        outages: begin and end of each contact outage.
        absences: begin and end of each interval without an executive.
        waiting: numbers of bundles queued at the orbiter and of reports queued aboard.
    """

    title: str
    end_s: float
    commands: tuple[CommandLane, ...] = ()
    faults: tuple[TimeSpan, ...] = ()
    events: tuple[tuple[str, tuple[float, ...]], ...] = ()
    modes: tuple[tuple[Mode, float, float], ...] = ()
    panels: tuple[Panel, ...] = ()
    outages: tuple[tuple[float, float], ...] = ()
    absences: tuple[tuple[float, float], ...] = ()
    waiting: tuple[Levels, Levels] | None = None

    @property
    def relayed(self) -> bool:
        """Whether a command has a lane over the orbiter."""
        return any(each.passage is not None for each in self.commands)


def draw_timeline(timeline: RunTimeline) -> Figure:
    """Return the figure: rows with y in pixels downwards, and the panels below them."""
    heights = panel_heights_px(timeline)
    top_px = _TOP + _LEGEND_ROW * timeline.relayed
    with styled_figure(WIDTH_PX, top_px + sum(heights) + _BOTTOM, timeline.title) as figure:
        grid = grid_position(heights, top_px, _BOTTOM)
        all_axes = figure.subplots(len(heights), sharex=True, squeeze=False, gridspec_kw=grid)[:, 0]
        draw_rows(list(all_axes), timeline)
        _add_legend(figure, timeline)
    return figure


def grid_position(heights: Sequence[int], top_px: int, bottom_px: int) -> dict[str, Any]:
    """Return the grid parameters for a column of axes with these heights in pixels."""
    height = top_px + sum(heights) + bottom_px
    return {
        "left": LEFT_PX / WIDTH_PX,
        "right": 1 - RIGHT_PX / WIDTH_PX,
        "bottom": bottom_px / height,
        "top": 1 - top_px / height,
        "hspace": 0,
        "height_ratios": heights,
    }


def panel_heights_px(timeline: RunTimeline) -> list[int]:
    """Return the heights in pixels: all rows together, each panel, the queues."""
    rows = len({fault.name for fault in timeline.faults}) + len(timeline.events) + 1
    lanes_px = sum(lane.height_px for lane in timeline.commands) or LANE_PX
    panels_px = [_PANEL for _ in timeline.panels]
    waiting_px = [] if timeline.waiting is None else [QUEUE_PX]
    return [lanes_px + _GAP + rows * ROW_PX + _GAP, *panels_px, *waiting_px]


def draw_rows(all_axes: Sequence[Axes], timeline: RunTimeline) -> None:
    """Draw rows, panels and queues into axes with the heights of `panel_heights_px`."""
    above, *panels = all_axes
    absences = timeline.absences
    for axes in all_axes:
        axes.spines[["left", "top", "right"]].set_visible(False)
        axes.grid(axis="x", color=GRID, zorder=0.5)
        axes.set_axisbelow(True)
        for dark in (*timeline.outages, *absences):
            axes.axvspan(*dark, color=DARK, linewidth=0, zorder=0.2)
    for axes in all_axes[:-1]:
        axes.spines.bottom.set_visible(False)
        axes.tick_params(axis="x", bottom=False, labelbottom=False)
    rows_px = panel_heights_px(timeline)[0]
    above.set(xlim=(0, max(timeline.end_s, MIN_DRAWN_WAIT_S)), ylim=(rows_px, 0))
    above.yaxis.set_visible(False)
    names = [f"outage: no contact for {end - begin:.0f} s" for begin, end in timeline.outages]
    names += ["no executive"] * len(absences)
    for dark, text in zip((*timeline.outages, *absences), names, strict=True):
        above.text(mean(dark), -6, text, color=_DARK_INK, fontweight="bold", ha="center")
    top = draw_commands(above, timeline.commands) + _GAP
    for name in dict.fromkeys(fault.name for fault in timeline.faults):
        name_row(above, top, name, WRONG)
        for fault in timeline.faults:
            if fault.name == name:
                above.plot([fault.begin_s, fault.end_s], [top + ROW_PX / 2] * 2, **_FAULT)
        top += ROW_PX
    for name, times_s in timeline.events:
        name_row(above, top, name, WARNED)
        above.plot(times_s, [top + ROW_PX / 2] * len(times_s), **EVENT)
        top += ROW_PX
    draw_modes(above, timeline.modes, top)
    for axes, panel in zip(panels, timeline.panels, strict=False):
        draw_panel(axes, panel)
    if timeline.waiting is not None:
        draw_queues(panels[-1], *timeline.waiting)
    all_axes[-1].set_xlabel("seconds after the start")


def name_row(axes: Axes, top: float, name: str, colour: str) -> None:
    """Write the name of a row, truncated to the width of its column."""
    write_beside(axes, 46, top + ROW_PX / 2 + 5, _cut(name), color=colour)


def _cut(text: str, max_length: int = _TITLE) -> str:
    return text if len(text) <= max_length else f"{text[: max_length - 1].rstrip('-., ')}…"


def _colour(lane: CommandLane) -> str:
    return FAINT if lane.last is None else ENDS.get(lane.last.name, FAINT)


def draw_commands(axes: Axes, lanes: Sequence[CommandLane]) -> float:
    """Draw the commands below each other, and return the lower edge of the last in pixels."""
    if not lanes:
        write_beside(axes, 46, 25, "no command was sent", color=FAINT)
    bottom = 0
    for number, lane in enumerate(lanes, 1):
        top, bottom = bottom, bottom + lane.height_px
        draw_rule(axes, top)
        write_beside(axes, 36, top + 19, str(number), color=FAINT, ha="right")
        if lane.passage is not None:
            write_beside(axes, 46, top + 19, _cut(lane.title, 26), fontweight="bold")
            draw_passage(axes, lane.passage, top)
            continue
        write_beside(axes, 46, top + 19, _cut(lane.title), fontweight="bold")
        end = "no report" if lane.last is None else lane.last.name
        text = f"{end}: {lane.text}" if lane.text else end
        write_beside(axes, 46, top + 34, text, color=_colour(lane), fontsize=11 * POINT)
        _draw_lifecycle(axes, lane, top + 24)
    bottom = bottom or LANE_PX
    draw_rule(axes, bottom)
    return float(bottom)


def _draw_lifecycle(axes: Axes, lane: CommandLane, middle: float) -> None:
    """Draw waiting and execution of a command aboard."""
    received_s, started_s, ended_s = lane.received_s, lane.started_s, lane.ended_s
    waited_until_s = started_s if started_s is not None else ended_s
    if (
        received_s is not None
        and waited_until_s is not None
        and waited_until_s - received_s > MIN_DRAWN_WAIT_S
    ):
        axes.plot([received_s, waited_until_s], [middle, middle], **WAITING_FOR_TURN)
    if started_s is not None:
        until_s = axes.get_xlim()[1] if ended_s is None else ended_s
        axes.plot([started_s, until_s], [middle, middle], **WORK)
        axes.plot(started_s, middle, **STARTED)
    if ended_s is not None:
        colour = _colour(lane)
        axes.plot(ended_s, middle, **{**ENDED, "color": colour, "markeredgecolor": colour})
    elif received_s is not None and started_s is None:
        axes.plot(received_s, middle, **RECEIVED)
    axes.plot(lane.sent_s, [middle] * len(lane.sent_s), **SENT)
    if lane.figures and ended_s is not None:
        late = ended_s > axes.get_xlim()[1] / 2
        text_s = min([*lane.sent_s, ended_s]) if late else ended_s
        axes.annotate(
            lane.figures,
            (text_s, middle),
            (-12 if late else 12, 0),
            textcoords="offset points",
            ha="right" if late else "left",
            va="center_baseline",
            fontsize=11 * POINT,
            color=_colour(lane),
        )


def draw_modes(axes: Axes, modes: Sequence[tuple[Mode, float, float]], top: float) -> None:
    """Draw a row of modes, with their names where the width suffices."""
    write_beside(axes, 46, top + ROW_PX / 2 + 5, "mode", color=INK)
    px_per_s = (WIDTH_PX - LEFT_PX - RIGHT_PX) / axes.get_xlim()[1]
    for mode, begin_s, end_s in modes:
        axes.broken_barh(
            [(begin_s, end_s - begin_s)], (top + 4, ROW_PX - 8), color=_MODES[mode], zorder=2
        )
        if px_per_s * (end_s - begin_s) > 9 * len(mode.name):
            axes.text(
                (begin_s + end_s) / 2,
                top + ROW_PX / 2,
                mode.name,
                ha="center",
                va="center_baseline",
                fontsize=10 * POINT,
            )


def _add_legend(figure: Figure, timeline: RunTimeline) -> None:
    """Add the legend; marks of faults and events only if there are any."""
    if timeline.relayed:
        add_legend_row(figure, 48, LEGEND)
    entries: dict[str, list[Style]] = {
        "sent": [SENT],
        "queued aboard": [WAITING_FOR_TURN],
        "started": [STARTED],
        "executed, ended": [WORK, ENDED],
    }
    if timeline.relayed:
        entries = dict(LEGEND_OF_WAITING)
    if timeline.faults:
        entries["fault or cargo"] = [_FAULT]
    if timeline.events:
        entries["event aboard"] = [EVENT]
    add_legend_row(figure, 48 + _LEGEND_ROW * timeline.relayed, entries)
