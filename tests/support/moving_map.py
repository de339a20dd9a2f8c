"""Draws a run in lock step as a moving picture: an SVG without a script, for light and dark pages.

python -m tests.support.moving_map config/demo/jackal.yaml docs/images/drive.svg
"""

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import accumulate, pairwise
from math import degrees, dist
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from executive.commands import SetCameraAngles, Stop, Waypoint, request_text
from executive.values.geometry import Point, Pose, wrap_rad
from sim.rover import Rock
from sim.scenario.model import Scenario
from sim.scenario.outcome import run_once
from sim.scenario.pictures import planned_waypoints
from sim.scenario.reading import load_scenario
from sim.scenario.record import Answer, Record, TruePose

SPEED: Final = 2.0
HOLD_S: Final = 6.0
"""How long the end is shown, before it begins again."""
SHOWN_FIRST_S: Final = 2.0
"""How long of that is shown first, so that a reader sees the whole at once."""
WIDTH, HEIGHT, MARGIN, ROW = 960, 452, 14, 43
PIXELS_PER_M: Final = 58.0
AROUND_M: Final = 0.75
STEP_M, STEP_RAD = 0.1, 0.12
"""Pose changes between two key frames."""
STANDSTILL_S: Final = 0.5
"""After this time without a key frame, the rover was stationary: its last pose gets one."""
TITLE_CUT, TEXT_CUT = 62, 82
STYLE: Final = """
:root{--back:#fff;--ink:#1f2328;--faint:#656d76;--soil:#f7f1e8;--rock:#b8ab9d;--edge:#80746a;
--plan:#57606a;--drive:#0067a5;--done:#00785a;--wrong:#c8321e;--warn:#8a5f00;--line:#d0d7de}
@media (prefers-color-scheme:dark){:root{--back:#0d1117;--ink:#e6edf3;--faint:#9198a1;
--soil:#2a231c;--rock:#6d6157;--edge:#94877b;--plan:#b7bdc8;--drive:#58b4f0;--done:#3fb98f;
--wrong:#ff7b66;--warn:#e0b04c;--line:#3d444d}}
text{font:13px "DejaVu Sans",Verdana,"Segoe UI",sans-serif;fill:var(--ink)}
.t{font-weight:bold}.s{font-size:12px}.n{fill:var(--faint)}
.EXECUTED{fill:var(--done)}.REJECTED,.FAILED{fill:var(--wrong)}
.CANCELLED,.DUPLICATE{fill:var(--warn)}
.a{animation:linear infinite;animation-duration:%.1fs;animation-delay:-%.1fs}
@media (prefers-reduced-motion:reduce){.a{animation:none!important}}
"""
REPEATED: Final = "answered from the ledger, not executed again"
ANSWER_S: Final = 0.4
"""From a repeat to its answer, in the picture; the run has it at once."""


@dataclass(frozen=True, slots=True)
class Row:
    """A command that was sent: its text, its end, and the times of both."""

    title: str
    sent_s: float
    stage: str
    text: str
    ended_s: float


def rows_of(record: Record) -> Iterator[Row]:
    """Yield the commands that were sent, except those to the camera's mount."""
    requests = {each.identity: each.request for each in record.requested}
    histories = record.all_lifecycles()
    for sent in record.sendings:
        request, history = requests.get(sent.identity), histories.get(sent.identity)
        if isinstance(request, SetCameraAngles) or history is None or history.end is None:
            continue
        end, at_s = history.end, sent.time_s
        title = request_text(request) if request is not None else history.name
        if sent.answer is Answer.DUPLICATE:
            yield Row(f"{title}, sent again", at_s, "DUPLICATE", REPEATED, at_s + ANSWER_S)
        elif end.stage is not None:
            text = f"{end.text} (reason {end.reason.value})" if end.reason else end.text
            yield Row(title, at_s, end.stage.name, text, record.time_of(end))


def thinned(poses: Sequence[TruePose]) -> list[tuple[TruePose, float]]:
    """Return the poses of the key frames, each with its heading without jumps, in rad."""
    headings = [each.pose.heading_rad for each in poses]
    turns = (wrap_rad(end - start) for start, end in pairwise(headings))
    chosen: list[tuple[TruePose, float]] = []
    skipped: tuple[TruePose, float] | None = None
    for each in zip(poses, accumulate(turns, initial=headings[0]), strict=True):
        if chosen and each[0] is not poses[-1]:
            last, last_rad = chosen[-1]
            apart_m = last.pose.point.distance_m(each[0].pose.point)
            if apart_m < STEP_M and abs(each[1] - last_rad) < STEP_RAD:
                skipped = each
                continue
            if skipped is not None and each[0].time_s - last.time_s > STANDSTILL_S:
                chosen.append(skipped)
        chosen.append(each)
        skipped = None
    return chosen


def cut(text: str, length: int) -> str:
    return escape(text if len(text) <= length else f"{text[: length - 1].rstrip()}…")


def _hyphened(name: str) -> str:
    return name.strip("_").replace("_", "-")


def tag(name: str, *inside: str, **attributes: object) -> str:
    """Return an element; underscores of attributes become hyphens."""
    written = "".join(f' {_hyphened(key)}="{value}"' for key, value in attributes.items())
    return f"<{name}{written}>{''.join(inside)}</{name}>"


def moving(frames: str, *inside: str, style: str = "") -> str:
    """Return a group with key frames; without motion it has the style."""
    return tag("g", *inside, class_="a", style=f"animation-name:{frames};{style}")


@dataclass(slots=True)
class Picture:
    """A run as a picture; a method draws each part."""

    scenario: Scenario
    record: Record
    rows: list[Row]
    keys: list[str] = field(default_factory=list)

    @property
    def run_s(self) -> float:
        return max(row.ended_s for row in self.rows) + 1.0

    @property
    def period_s(self) -> float:
        return self.run_s / SPEED + HOLD_S

    def draw(self) -> str:
        """Return the SVG."""
        poses = [each for each in self.record.poses if each.time_s <= self.run_s]
        goals = planned_waypoints(self.record)
        points = [each.pose.point for each in poses] + [Point(at.x_m, at.y_m) for at in goals]
        west_m, north_m = min(at.x_m for at in points), max(at.y_m for at in points)
        frame = Frame(west_m - AROUND_M, north_m + AROUND_M)
        across, down = frame.pixels(
            Point(max(at.x_m for at in points) + AROUND_M, min(at.y_m for at in points) - AROUND_M)
        )
        ground = tag("rect", width="100%", height="100%", rx=4, fill="var(--soil)")
        line, *waypoints = self._plan(frame, goals)
        track, *marks = self._drive(frame, poses)
        parts = (ground, *self._rocks(frame), line, track, *waypoints, *marks)
        left, top = MARGIN + across + 18, (HEIGHT - down) / 2
        title = f"{self.scenario.title}: a run of {self.run_s:.0f} s, {SPEED:g} times as fast"
        inside = [
            tag("rect", width=WIDTH, height=HEIGHT, rx=6, fill="var(--back)", stroke="var(--line)"),
            tag("text", escape(title), x=f"{left:.0f}", y=32, class_="t"),
            self._progress(),
            tag(
                "svg", *parts, x=MARGIN, y=f"{top:.0f}", width=f"{across:.0f}", height=f"{down:.0f}"
            ),
            *self._texts(left),
        ]
        style = STYLE % (self.period_s, self.period_s - SHOWN_FIRST_S) + "".join(self.keys)
        size = {"viewBox": f"0 0 {WIDTH} {HEIGHT}", "width": WIDTH, "height": HEIGHT}
        named = {"xmlns": "http://www.w3.org/2000/svg", "role": "img", "aria_label": escape(title)}
        return tag("svg", tag("style", style), *(f"\n{each}" for each in inside), **named, **size)

    def _share(self, time_s: float) -> str:
        return f"{100 * min(time_s, self.run_s) / SPEED / self.period_s:.2f}%"

    def _appearing(self, name: str, time_s: float, *inside: str) -> str:
        begin, end = self._share(time_s), self._share(time_s + 0.2)
        self.keys.append(f"@keyframes {name}{{0%,{begin}{{opacity:0}}{end},100%{{opacity:1}}}}")
        return moving(name, *inside)

    def _progress(self) -> str:
        end = f"{self._share(self.run_s)},100%{{transform:scaleX(1)}}"
        self.keys.append(f"@keyframes run{{0%{{transform:scaleX(0)}}{end}}}")
        lower_left: dict[str, object] = {"x": MARGIN, "y": HEIGHT - 8, "height": 3}
        bar = tag("rect", **lower_left, width=WIDTH - 2 * MARGIN, fill="var(--line)")
        return moving("run", bar, style=f"transform-origin:{MARGIN}px 0")

    def _rocks(self, frame: "Frame") -> Iterator[str]:
        rocks: Sequence[Rock] = self.scenario.world.all_rocks
        for rock in rocks:
            x, y = frame.pixels(Point(rock.x_m, rock.y_m))
            if -50 < x < WIDTH / 2 and -50 < y < HEIGHT:
                size = {
                    "cx": f"{x:.0f}",
                    "cy": f"{y:.0f}",
                    "r": f"{PIXELS_PER_M * rock.radius_m:.0f}",
                }
                yield tag("circle", **size, fill="var(--rock)", stroke="var(--edge)")

    def _plan(self, frame: "Frame", goals: Sequence[Waypoint]) -> Iterator[str]:
        """Yield the planned line, then the waypoints."""
        spots = [frame.pixels(Point(goal.x_m, goal.y_m)) for goal in goals]
        start = frame.pixels(self.scenario.world.start_pose.point)
        line = " ".join(f"{x:.0f},{y:.0f}" for x, y in (start, *spots))
        yield tag(
            "polyline", points=line, fill="none", stroke="var(--plan)", stroke_dasharray="3 4"
        )
        for number, (x, y) in enumerate(spots, 1):
            at = {"cx": f"{x:.0f}", "cy": f"{y:.0f}"}
            yield tag("circle", **at, r=9, fill="var(--back)", stroke="var(--plan)")
            at = {"x": f"{x:.0f}", "y": f"{y + 4:.0f}"}
            yield tag("text", str(number), **at, class_="s", text_anchor="middle")

    def _drive(self, frame: "Frame", poses: Sequence[TruePose]) -> Iterator[str]:
        """Yield the track, then the stops and the rover."""
        frames = [
            (each.time_s, *frame.pixels(each.pose.point), turned_rad)
            for each, turned_rad in thinned(poses)
        ]
        steps = (dist(start[1:3], end[1:3]) for start, end in pairwise(frames))
        lengths = list(accumulate(steps, initial=0.0))
        moves = [
            (self._share(at_s), _placed(x, y, turned_rad)) for at_s, x, y, turned_rad in frames
        ]
        grows = [
            (share, f"stroke-dashoffset:{lengths[-1] - length:.1f}px")
            for (share, _), length in zip(moves, lengths, strict=True)
        ]
        for name, keys in (("move", moves), ("grow", grows)):
            written = "".join(
                f"{share}{{{style}}}" for share, style in (*keys, ("100%", keys[-1][1]))
            )
            self.keys.append(f"@keyframes {name}{{{written}}}")
        points = " ".join(f"{x:.1f},{y:.1f}" for _, x, y, _ in frames)
        line: dict[str, object] = {"stroke": "var(--drive)", "stroke_width": 3, "fill": "none"}
        yield moving(
            "grow",
            tag("polyline", points=points, **line),
            style=f"stroke-dasharray:{lengths[-1]:.1f}",
        )
        for number, row in enumerate(self.rows):
            if row.title == request_text(Stop()):
                x, y = frame.pixels(_at(poses, row.ended_s).point)
                sign = {"d": SIGN, "transform": f"translate({x:.0f},{y:.0f})"}
                drawn = tag("path", **sign, fill="var(--wrong)", stroke="var(--back)")
                yield self._appearing(f"stop{number}", row.sent_s, drawn)
        yield moving("move", *ROVER, style=moves[-1][1])

    def _texts(self, left: float) -> Iterator[str]:
        at = {"x": f"{left + 18:.0f}"}
        for number, row in enumerate(self.rows, 1):
            y = 58 + ROW * (number - 1)
            counted = tag("text", str(number), x=f"{left:.0f}", y=y, class_="n")
            title = tag("text", cut(row.title, TITLE_CUT), **at, y=y)
            yield self._appearing(f"sent{number}", row.sent_s, counted, title)
            stage = tag("tspan", row.stage, class_="t")
            text = f"{stage} {cut(row.text, TEXT_CUT)}"
            ended = tag("text", text, **at, y=y + 17, class_=f"s {row.stage}")
            yield self._appearing(f"end{number}", row.ended_s, ended)


@dataclass(frozen=True, slots=True)
class Frame:
    """The upper left corner of the map."""

    west_m: float
    north_m: float

    def pixels(self, at: Point) -> tuple[float, float]:
        return PIXELS_PER_M * (at.x_m - self.west_m), PIXELS_PER_M * (self.north_m - at.y_m)


def _placed(x: float, y: float, turned_rad: float) -> str:
    return f"transform:translate({x:.1f}px,{y:.1f}px) rotate({-degrees(turned_rad):.0f}deg)"


def _at(poses: Sequence[TruePose], time_s: float) -> Pose:
    return min(poses, key=lambda each: abs(each.time_s - time_s)).pose


SIGN: Final = "M-4-10h8l6 6v8l-6 6h-8l-6-6v-8z"
ROVER: Final = (
    tag("rect", x=-14.7, y=-12.5, width=29.4, height=25, rx=3, fill="var(--ink)"),
    tag("path", d="M4-7L12 0L4 7z", fill="var(--back)"),
)


def main(name: str, path: Path) -> None:
    scenario = load_scenario(name)
    with TemporaryDirectory() as folder:
        record = run_once(name, scenario, Path(folder)).record
        path.write_text(f"{Picture(scenario, record, list(rows_of(record))).draw()}\n")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
