"""Draws a mission without and with its fault: its nodes over time and the track, as one SVG.

python -m tests.support.mission_timeline docs/images
"""

import sys
from collections.abc import Callable, Iterator, Sequence
from html import escape
from itertools import pairwise
from math import log2
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from executive.values.geometry import Point
from tests.support.missions import ALL_MISSIONS, MissionRun, Span, run_mission, time_of

LEFT, RIGHT, MAP, ROW, HEAD, MARGIN = 190, 640, 140, 15, 24, 8
WIDTH: Final = RIGHT + MAP + 2 * MARGIN
MIN_LABEL_PX: Final = 58
MAX_MAP_PX_PER_M: Final = 40.0
MAX_DEVIATION_M: Final = 0.05
"""Maximum distance of the drawn track from the driven one."""
STYLE: Final = (
    ":root{background:#fff;color:#1f2328}"
    "@media(prefers-color-scheme:dark){:root{background:#0d1117;color:#e6edf3}}"
    "text{font:11px Verdana,sans-serif;fill:currentColor}.t{font-weight:bold}"
    "path{fill:none;stroke-width:9}.l{stroke:#808890;stroke-width:1.2}.w{stroke-opacity:.45}"
    ".g{stroke:#1a9c74}.r{stroke:#e0503a}.a{stroke:#c08a1a}"
)
"""For light and dark pages."""
CLASSES: Final = {"SUCCESS": "g", "FAILURE": "r", "HALTED": "a", "RUNNING": "a"}
MARKS: Final = {"FAILURE": "✗", "HALTED": "■"}
SHOWN: Final = (
    *("Near", "Reachable", "FaultActive", "ScriptCondition", "AlwaysFailure"),
    *("Sleep", "WaitUntil", "WaitFor", "Ask", "Window", "Timeout"),
)
"""The nodes that have rows, beside those with commands."""


def draw(runs: Sequence[MissionRun]) -> str:
    """Return the picture of the runs of a mission, one below the other."""
    parts: list[str] = []
    top_px = MARGIN
    for run in runs:
        rows = rows_of(run)
        parts += _lane(run, rows, top_px)
        top_px += HEAD + max(len(rows) * ROW, 90) + 2 * ROW
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {top_px}" role="img">'
        f"<title>{runs[0].mission.name}</title><style>{STYLE}</style>"
        + "\n".join(parts)
        + "</svg>\n"
    )


def rows_of(run: MissionRun) -> list[str]:
    """Return the names of the shown nodes, by their first begin."""
    return list(dict.fromkeys(_name(each) for each in run.spans if _is_shown(each)))


def _is_shown(span: Span) -> bool:
    return span.is_step or span.plan.kind.name in SHOWN


def _name(span: Span) -> str:
    return span.plan.location.name


def _lane(run: MissionRun, rows: Sequence[str], top_px: int) -> Iterator[str]:
    spans = [each for each in run.spans if _is_shown(each)]
    ends_px = _scale(run, spans)
    yield _text(MARGIN, top_px + 11, f"{run.scene.title}: {run.last.status.name}", "t")
    low_px = top_px + HEAD
    bars: dict[str, str] = {}
    for span in spans:
        x_px, end_px = ends_px(span.begin_utc_s), ends_px(span.end_utc_s)
        y_px = low_px + rows.index(_name(span)) * ROW
        waits = "" if span.is_step or x_px == end_px else " w"
        kind = CLASSES[span.result] + waits
        bars[kind] = bars.get(kind, "") + f"M{x_px} {y_px}h{max(end_px - x_px, 2)}"
        if span.result in MARKS:
            yield _text(max(end_px, x_px + 2) + 2, y_px + 4, MARKS[span.result])
    for name in rows:
        yield _text(MARGIN, low_px + rows.index(name) * ROW + 4, name)
    yield from (f'<path class="{kind}" d="{path}"/>' for kind, path in bars.items())
    yield from _axis(run, spans, ends_px, low_px + len(rows) * ROW + 4)
    yield from _map(run, low_px)


def _scale(run: MissionRun, spans: Sequence[Span]) -> Callable[[float], int]:
    """Return the axis of time: intervals between events are shown by their logarithm."""
    times = sorted({run.begin_utc_s, *(t for s in spans for t in (s.begin_utc_s, s.end_utc_s))})
    widths = [log2(1.0 + after - before) for before, after in pairwise(times)]
    total, at = sum(widths) or 1.0, 0.0
    known = {times[0]: LEFT}
    for time_s, width in zip(times[1:], widths, strict=True):
        at += width
        known[time_s] = LEFT + round((RIGHT - LEFT - 46) * at / total)
    return known.__getitem__


def _axis(
    run: MissionRun, spans: Sequence[Span], x_of: Callable[[float], int], y_px: int
) -> Iterator[str]:
    """Yield the times of begins and ends that have room."""
    yield f'<path class="l" d="M{LEFT} {y_px - 6}H{RIGHT}"/>'
    times = sorted({run.begin_utc_s, *(t for s in spans for t in (s.begin_utc_s, s.end_utc_s))})
    last_px = x_of(times[-1])
    free_px = LEFT
    for time_s in times:
        x_px = x_of(time_s)
        if x_px >= free_px and (x_px == last_px or x_px + MIN_LABEL_PX <= last_px):
            yield _text(x_px, y_px + 6, time_of(time_s))
            free_px = x_px + MIN_LABEL_PX


def _map(run: MissionRun, top_px: int) -> Iterator[str]:
    """Yield the track, from its begin to its end with a ring; north is up."""
    track, areas = simplified(run.track), [[Point(*each) for each in run.scene.keep_out]]
    if len(track) < 2:
        return
    xs_m, ys_m = zip(*((each.x_m, each.y_m) for each in (*track, *areas[0])), strict=True)
    width_m, height_m = max(xs_m) - min(xs_m), max(ys_m) - min(ys_m)
    scale = min(MAX_MAP_PX_PER_M, (MAP - 20) / max(width_m, 0.1), 80 / max(height_m, 0.1))

    def pixels(point: Point) -> str:
        x_px = RIGHT + 2 * MARGIN + (point.x_m - min(xs_m)) * scale
        return f"{x_px:.0f} {top_px + (max(ys_m) - point.y_m) * scale:.0f}"

    corners = [f"M{'L'.join(map(pixels, area))}z" for area in areas if area]
    ring = f"M{pixels(track[-1])}m-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0"
    path = f"M{'L'.join(map(pixels, track))}{''.join(corners)}{ring}"
    yield f'<path class="l" d="{path}"/>'
    bottom_px = round(top_px + height_m * scale) + 16
    text = f"ends at {round(run.pose.x_m, 1) + 0.0}, {round(run.pose.y_m, 1) + 0.0} m"
    yield _text(RIGHT + 2 * MARGIN - 4, bottom_px, text)


def simplified(track: Sequence[Point]) -> list[Point]:
    """Return the corners of a track (Ramer, Douglas and Peucker)."""
    if len(track) < 3:
        return list(track)
    first, last = track[0], track[-1]
    apart_m = [_apart_m(each, first, last) for each in track]
    corner = max(range(len(track)), key=apart_m.__getitem__)
    if apart_m[corner] <= MAX_DEVIATION_M:
        return [first, last]
    return [*simplified(track[: corner + 1])[:-1], *simplified(track[corner:])]


def _apart_m(point: Point, first: Point, last: Point) -> float:
    length_m = first.distance_m(last)
    if length_m == 0.0:
        return first.distance_m(point)
    across = (last.x_m - first.x_m) * (point.y_m - first.y_m)
    across -= (last.y_m - first.y_m) * (point.x_m - first.x_m)
    return abs(across) / length_m


def _text(x_px: int, y_px: int, text: str, kind: str = "") -> str:
    named = f' class="{kind}"' if kind else ""
    return f'<text x="{x_px}" y="{y_px}"{named}>{escape(text)}</text>'


def main(images: Path) -> None:
    """Draw all missions."""
    for mission in ALL_MISSIONS:
        with TemporaryDirectory() as first, TemporaryDirectory() as second:
            runs = [
                run_mission(mission, scene, Path(folder))
                for scene, folder in ((mission.nominal, first), (mission.fault, second))
            ]
        path = images / f"mission-{mission.name[:2]}.svg"
        path.write_text(draw(runs), encoding="utf-8")
        print(path, path.stat().st_size)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
