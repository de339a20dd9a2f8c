"""The timeline of sessions: each command on its way between ground, orbiter and rover."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from statistics import mean
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator

from adapters.mrs.spec import Stage
from sim.demo.mission import Played
from sim.demo.script import Ending, Link
from sim.demo.session import Life, Session, Told
from sim.drawing import (
    COMMAND,
    DONE,
    ENDED,
    FAINT,
    GRID,
    INK,
    LEFT_PX,
    POINT,
    RECEIVED,
    RIGHT_PX,
    SENT,
    STARTED,
    TURN,
    WARNED,
    WIDTH_PX,
    WORK,
    WRONG,
    add_legend_row,
    draw_rule,
    line,
    mark,
    sheet,
    write_beside,
)
from sim.processes.relay import Orbiter

SHORT_S: Final = 0.4
"""What waits for less does not wait; a command that takes less is one mark."""
DARK, DARK_INK = "#dde1ed", "#3a4466"
_TOP, _BOTTOM = 92, 58
_LEGEND_ROW: Final = 36
"""An eclipse takes another row of the legend, and its name."""
_LANE, _HEADING, _QUEUE = 62, 30, 104
_GROUND, _ORBITER, _ROVER, _REPORT = 14, 29, 44, 54
"""Where the levels of a lane are, below its top."""
_TITLE: Final = 28
Levels = tuple[tuple[float, int], ...]
"""How many wait, each from a time on."""
_COLOUR: Final = {
    None: FAINT,
    Ending.EXECUTED: DONE,
    Ending.CANCELLED: WARNED,
    Ending.REJECTED: WARNED,
    Ending.DUPLICATE: WARNED,
    Ending.FAILED: WRONG,
    Ending.EXPIRED: WRONG,
}


_STORED: Final = mark("o", 10, COMMAND)
_TOLD: Final = mark("o", 10, DONE)
_LOST: Final = mark("x", 12, WRONG, markeredgecolor=WRONG, markeredgewidth=2.5)
_WAY: Final = line(COMMAND, 2)
_STORAGE: Final = line(COMMAND, 5)
_REPORTED: Final = line(DONE, 1.8)


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

    @property
    def short(self) -> bool:
        """Whether all of it happened at once, as far as one can see."""
        return self.ended is not None and self.ended.told_s - self.sent_s < SHORT_S


@dataclass(frozen=True, slots=True)
class Timeline:
    """What the picture shows.

    Attributes:
        rovers: the commands of each, below a heading that may be empty.
        eclipses: from when to when there was no contact.
        commands: how many bundles waited at the orbiter.
        reports: how many reports waited aboard.
    """

    title: str
    rovers: tuple[tuple[str, tuple[Lane, ...]], ...]
    eclipses: tuple[tuple[float, float], ...] = ()
    commands: Levels = ()
    reports: Levels = ()
    end_s: float = 0.0


def timeline_of(played: Sequence[Played], orbiter: Orbiter) -> Timeline:
    """Return the timeline of sessions that were played at the same time."""
    sessions = [each.session for each in played]
    start_utc_s = min(session.lives[0].sent_utc_s for session in sessions)
    ends = [told.utc_s for session in sessions for life in session.lives for told in life.told]
    several = len(played) > 1
    rovers = tuple(
        (
            each.participant.script.title if several else "",
            tuple(lane_of(life, start_utc_s) for life in each.session.lives),
        )
        for each in played
    )
    since_s = orbiter.start_utc_s - start_utc_s
    eclipses = tuple(
        (since_s + eclipse.begin_s, since_s + eclipse.end_s) for eclipse in orbiter.eclipses
    )
    title = f"Commands to {' and '.join(each.participant.script.title for each in played)}"
    return Timeline(
        title=f"{title} through an eclipse" if eclipses else f"{title}, by two links",
        rovers=rovers,
        eclipses=eclipses,
        commands=_queue(sessions[0], start_utc_s),
        reports=_aboard(sessions[0], start_utc_s),
        end_s=max(ends) - start_utc_s,
    )


def waited(session: Session) -> Iterator[tuple[str, str]]:
    """Yield figures of what waited: a name, and what is to be said of it."""
    lives = ((life, _left_utc_s(life)) for life in session.lives)
    stored_s = [left - life.sent_utc_s for life, left in lives if left is not None]
    told_s = [told.utc_s - told.aboard_utc_s for told in session.reports[Link.RELAY]]
    names = ("commands that waited at the orbiter", "reports that waited aboard")
    for name, waits_s in zip(names, (stored_s, told_s), strict=True):
        long_s = [wait_s for wait_s in waits_s if wait_s > SHORT_S]
        figure = f"{len(long_s)} of {len(waits_s)}"
        yield name, figure + (f", the longest for {max(long_s):.1f} s" if long_s else "")


def lane_of(life: Life, start_utc_s: float) -> Lane:
    """Return the lane of a life; times since a start."""

    def passage(told: Told | None) -> Passage | None:
        if told is None:
            return None
        made_utc_s = max(told.aboard_utc_s, life.sent_utc_s)  # a repeat is told what was before
        return Passage(made_utc_s - start_utc_s, told.utc_s - start_utc_s)

    taken_utc_s = life.taken_utc_s if life.stored else None
    return Lane(
        title=life.spelled,
        link=life.step.link,
        ending=life.ending,
        sent_s=life.sent_utc_s - start_utc_s,
        stored_s=None if taken_utc_s is None else taken_utc_s - start_utc_s,
        received=passage(life.reached(Stage.RECEIVED)),
        started=passage(life.reached(Stage.STARTED)),
        ended=None if life.lost else passage(life.ended),
        lost_s=life.lost.utc_s - start_utc_s if life.lost else None,
        again=life.step.repeats,
    )


def _left_utc_s(life: Life) -> float | None:
    """Return when a command left the orbiter, for the rover or because it was given up."""
    if not life.stored or life.lost is not None:
        return life.lost.utc_s if life.stored and life.lost else None
    received = life.reached(Stage.RECEIVED)
    return None if received is None else received.aboard_utc_s


def _queue(session: Session, start_utc_s: float) -> Levels:
    """Return how many bundles waited at the orbiter, where that changed."""
    seen = [(utc_s - start_utc_s, int(status.queued)) for utc_s, status in session.relay_history]
    return tuple(later for earlier, later in pairwise(seen) if later[1] != earlier[1])


def _aboard(session: Session, start_utc_s: float) -> Levels:
    """Return how many reports waited aboard, where that changed."""
    changes: list[tuple[float, int]] = []
    for told in session.reports[Link.RELAY]:
        if told.notification.sequence and told.utc_s - told.aboard_utc_s > SHORT_S:
            changes += [(told.aboard_utc_s, 1), (told.utc_s, -1)]
    changes.sort()
    waiting = accumulate(change for _, change in changes)
    return tuple(
        (utc_s - start_utc_s, many) for (utc_s, _), many in zip(changes, waiting, strict=True)
    )


def draw_timeline(timeline: Timeline) -> Figure:
    """Return the picture: one lane a command, y in pixels below the first; below, what waited."""
    dark = bool(timeline.eclipses)
    rovers_px = (bool(name) * _HEADING + len(lanes) * _LANE for name, lanes in timeline.rovers)
    lanes_px = max(1, sum(rovers_px))
    top = _TOP + dark * _LEGEND_ROW
    heights = [lanes_px, _QUEUE] if dark else [lanes_px]
    height = top + sum(heights) + _BOTTOM
    begin_s, end_s = limits_s = (-1.0, timeline.end_s + 1.0)
    shown = [(max(begin_s, begin), min(end_s, end)) for begin, end in timeline.eclipses]
    with sheet(WIDTH_PX, height, timeline.title) as figure:
        place = {
            "left": LEFT_PX / WIDTH_PX,
            "right": 1 - RIGHT_PX / WIDTH_PX,
            "bottom": _BOTTOM / height,
            "top": 1 - top / height,
            "hspace": 0,
            "height_ratios": heights,
        }
        rows = figure.subplots(len(heights), sharex=True, squeeze=False, gridspec_kw=place)[:, 0]
        for axes in rows:
            axes.spines[["left", "top", "right"]].set_visible(False)
            axes.grid(axis="x", color=GRID, zorder=0.5)
            axes.set_axisbelow(True)
            for eclipse in shown:
                axes.axvspan(*eclipse, color=DARK, linewidth=0, zorder=0.2)
        lanes, below = rows[0], rows[-1]
        lanes.set(xlim=limits_s, ylim=(lanes_px, 0))
        lanes.xaxis.set_major_locator(MultipleLocator(5 if timeline.end_s < 80 else 10))
        lanes.yaxis.set_visible(False)
        _draw_lanes(lanes, timeline.rovers)
        for middle, (begin, end) in zip(map(mean, shown), timeline.eclipses, strict=True):
            words = f"eclipse: no contact for {end - begin:.0f} s"
            lanes.text(middle, -8, words, color=DARK_INK, fontweight="bold", ha="center")
        if dark:
            lanes.spines.bottom.set_visible(False)
            lanes.tick_params(bottom=False)
            draw_rule(lanes, lanes_px)
            below.set_facecolor("none")
            _draw_queues(below, timeline)
        below.set_xlabel("seconds after the first command")
        _add_legend(figure, dark=dark)
    return figure


def _draw_lanes(axes: Axes, rovers: Sequence[tuple[str, Sequence[Lane]]]) -> None:
    top = 0.0
    for heading, lanes in rovers:
        if heading:
            write_beside(axes, 24, top + 21, heading, fontsize=15 * POINT, fontweight="bold")
            top += _HEADING
        for number, lane in enumerate(lanes, 1):
            _draw_lane(axes, lane, number, top)
            top += _LANE


def _draw_lane(axes: Axes, lane: Lane, number: int, top: float) -> None:
    draw_rule(axes, top)
    words = f"again: {lane.title}" if lane.again else lane.title
    title = words if len(words) <= _TITLE else f"{words[: _TITLE - 1].rstrip('-., ')}…"
    ending = "under way" if lane.ending is None else lane.ending.value
    link = "relay" if lane.link is Link.RELAY else "direct link"
    write_beside(axes, 36, top + 27, str(number), color=FAINT, ha="right")
    write_beside(axes, 46, top + 27, title, fontweight="bold")
    write_beside(axes, 46, top + 45, f"by {link}", fontsize=11 * POINT)
    colour = _COLOUR[lane.ending]
    write_beside(axes, 132, top + 45, ending, color=colour, fontsize=11 * POINT, fontweight="bold")
    levels = {"ground": top + _GROUND, "orbiter": top + _ORBITER, "rover": top + _ROVER}
    if lane.link is Link.DIRECT:
        del levels["orbiter"]
    for name, y in levels.items():
        write_beside(axes, LEFT_PX - 8, y + 3, name, color=FAINT, fontsize=9 * POINT, ha="right")
        axes.axhline(y, color="#c9c9c9", linewidth=0.5, zorder=0.6)
    if lane.short:
        _draw_short(axes, lane, top)
        return
    _draw_way_up(axes, lane, top)
    if not lane.again:
        _draw_work(axes, lane, top + _ROVER)
    for passage in (lane.received, lane.started, lane.ended):
        if passage is not None:
            _draw_report(axes, passage, top)
    axes.plot(lane.sent_s, top + _GROUND, **SENT)


def _draw_short(axes: Axes, lane: Lane, top: float) -> None:
    """Draw a command that was done at once as one mark, and say how long it took."""
    assert lane.ended is not None
    ground, rover, sent_s = top + _GROUND, top + _ROVER, lane.sent_s
    axes.plot([sent_s, sent_s], [ground, rover], **_WAY)
    axes.plot(sent_s, ground, **SENT)
    if not lane.again:
        axes.plot(sent_s, rover, **RECEIVED)
    late = sent_s > 0.8 * axes.get_xlim()[1]
    axes.annotate(
        f"told after {lane.ended.told_s - sent_s:.2f} s",
        (sent_s, ground),
        xytext=(-8 if late else 8, 0),
        textcoords="offset points",
        ha="right" if late else "left",
        va="center_baseline",
        color=DONE,
        fontsize=10 * POINT,
        bbox={"facecolor": "white", "linewidth": 0, "pad": 1},
    )


def _draw_way_up(axes: Axes, lane: Lane, top: float) -> None:
    """Draw a command from the ground to the rover, or to where it was given up."""
    ground, orbiter, rover = top + _GROUND, top + _ORBITER, top + _ROVER
    arrived_s = lane.lost_s if lane.received is None else lane.received.made_s
    if lane.stored_s is None:
        if arrived_s is not None:
            axes.plot([lane.sent_s, arrived_s], [ground, rover], **_WAY)
    else:
        axes.plot([lane.sent_s, lane.sent_s], [ground, orbiter], **_WAY)
        if arrived_s is not None and arrived_s - lane.stored_s > SHORT_S:
            axes.plot([lane.sent_s, arrived_s], [orbiter, orbiter], **_STORAGE)
        if lane.lost_s is not None:
            axes.plot(lane.lost_s, orbiter, **_LOST)
        elif arrived_s is not None:
            axes.plot([arrived_s, arrived_s], [orbiter, rover], **_WAY)
        axes.plot(lane.sent_s, orbiter, **_STORED)
    if lane.received is not None:
        axes.plot(lane.received.made_s, rover, **RECEIVED)


def _draw_work(axes: Axes, lane: Lane, rover: float) -> None:
    """Draw how long a command waited aboard, and was carried out."""
    received, started, ended = lane.received, lane.started, lane.ended
    if received is not None and started is not None and started.made_s - received.made_s > SHORT_S:
        axes.plot([received.made_s, started.made_s], [rover, rover], **TURN)
    if started is not None and ended is not None:
        axes.plot([started.made_s, ended.made_s], [rover, rover], **WORK)
        axes.plot(ended.made_s, rover, **ENDED)
        axes.plot(started.made_s, rover, **STARTED)


def _draw_report(axes: Axes, passage: Passage, top: float) -> None:
    """Draw a report from the rover to the ground, after it waited aboard."""
    made_s, told_s = passage.made_s, passage.told_s
    ground, rover, report = top + _GROUND, top + _ROVER, top + _REPORT
    if told_s - made_s > SHORT_S:
        axes.plot([made_s, made_s, told_s], [rover, report, report], **_REPORTED)
        rover = report
    axes.plot([told_s, told_s], [rover, ground], **_REPORTED)
    axes.plot(told_s, ground, **_TOLD)


def _draw_queues(axes: Axes, timeline: Timeline) -> None:
    most = max([1, *(many for _, many in (*timeline.commands, *timeline.reports))])
    axes.set_ylim(0, most * _QUEUE / (_QUEUE - 30))
    axes.set_yticks(MaxNLocator(5, integer=True).tick_values(0, most))
    axes.tick_params(axis="y", length=0, labelcolor=FAINT, labelsize=10 * POINT)
    axes.grid(axis="y", color=GRID)
    begin_s, end_s = axes.get_xlim()
    for levels, colour in ((timeline.reports, DONE), (timeline.commands, COMMAND)):
        steps = [(begin_s, 0), *levels]
        steps.append((end_s, steps[-1][1]))
        axes.step(*zip(*steps, strict=True), where="post", **line(colour, 2.5))
    named = (
        (34, "waiting", INK),
        (54, "bundles at the orbiter", COMMAND),
        (72, "reports aboard", DONE),
    )
    for y, words, colour in named:
        write_beside(
            axes, 46, axes.get_ylim()[1] * (1 - y / _QUEUE), words, color=colour, fontweight="bold"
        )


def _add_legend(figure: Figure, *, dark: bool) -> None:
    """Say what the marks mean; those of waiting and giving up only where there is an eclipse."""
    always = {
        "sent from the ground": [SENT],
        "stored at the orbiter": [_STORED],
        "received aboard": [RECEIVED],
        "started": [STARTED],
        "carried out, ended": [WORK, ENDED],
        "told on the ground": [_TOLD],
    }
    waiting = {
        "waits at the orbiter": [_STORAGE],
        "given up there": [_LOST],
        "waits aboard for its turn": [TURN],
        "report waits aboard": [_REPORTED],
    }
    for row, entries in enumerate((always, waiting) if dark else (always,)):
        add_legend_row(figure, 50 + 22 * row, entries)
