"""`rover watch FILE`: a recorded run as one tick, as all ticks by keys, or as an HTML page."""

import json
from importlib.resources import files
from math import degrees
from pathlib import Path
from typing import Final, TypeVar

import click
from rich.console import Console, Group, RenderableType
from rich.text import Text

from adapters.recording import Moment, RecordedMoments
from executive.values.reports import Report
from trees import COLOURS, DisplayStatus, branches, display_statuses, line
from trees.screen import STYLES, render

KEYS: Final = "→ ← a tick   ↓ ↑ a report   > < a second   g G the ends   q ends"
_SIGNS: Final = "legend: ● running  ✓ success  – nothing to do  ✕ failed"
_STEPS: Final = {"\x1b[C": 1, "\x1b[D": -1, "l": 1, "h": -1}
_EVENTS: Final = {"\x1b[B": 1, "\x1b[A": -1, "j": 1, "k": -1}
_SECONDS: Final = {">": 1.0, "<": -1.0}
_MAX_COMMANDS_SHOWN: Final = 6
"""Maximum commands shown: the last ones."""
Row = tuple[str, str, str, float | None]
"""A row of a tree: branch, node, display style, start of its status in s."""
_Value = TypeVar("_Value")


def show_moment(path: Path, at: str) -> None:
    """Print one tick of a recording, selected by `at` as in `rover watch --at`.

    Raises:
        RecordingError: the file cannot be used as a recording.
        click.UsageError: `at` matches no tick.
    """
    recorded = RecordedMoments(path)
    moment = recorded.moments[_index(recorded, path, at)]
    Console(highlight=False).print(_shown(recorded, moment, None))


def browse(path: Path, at: str) -> None:
    """Show the run from one tick on, controlled by keys.

    Raises:
        RecordingError: the file cannot be used as a recording.
        click.UsageError: `at` matches no tick.
    """
    recorded = RecordedMoments(path)
    index = _index(recorded, path, at)
    console = Console(highlight=False)
    last = len(recorded.moments) - 1
    with console.screen() as screen:
        while True:
            shown = _shown(
                recorded, recorded.moments[index], console.height - _MAX_COMMANDS_SHOWN - 8
            )
            screen.update(Group(shown, Text(), Text(KEYS, "dim")))
            key = click.getchar()
            if key == "q":
                return
            if key in _STEPS:
                index = min(max(index + _STEPS[key], 0), last)
            elif key in _EVENTS:
                index = recorded.next_event(index, _EVENTS[key])
            elif key in _SECONDS:
                index = recorded.index_at(recorded.moments[index].time_s + _SECONDS[key])
            elif key in "gG":
                index = 0 if key == "g" else last


def _index(recorded: RecordedMoments, path: Path, at: str) -> int:
    try:
        return recorded.index_at(float(at))
    except ValueError:
        index = recorded.index_of(at)
    if index is None:
        raise click.UsageError(
            f"--at {at}: {path} has no such command or reason; give seconds since its start,"
            " SOURCE:NUMBER, or the name of a reason such as WHEELS_OFF_COMMAND"
        )
    return index


def _shown(recorded: RecordedMoments, moment: Moment, height: int | None) -> RenderableType:
    notes = {path: f"since {since_s:.2f} s" for path, since_s in moment.since_s.items()}
    pose = "no odometry"
    if moment.pose is not None:
        heading_deg = degrees(moment.pose.heading_rad)
        pose = f"x {moment.pose.x_m:z.2f} y {moment.pose.y_m:z.2f} m, {heading_deg:z.0f}°"
    end_s = recorded.moments[-1].time_s
    lines = [Text(f"{moment.time_s:.2f} of {end_s:.2f} s   {pose}", "bold")]
    lines += [
        Text(f"{each.identity}  {each.stage.name if each.stage else ''}  {each.text}")
        for each in moment.commands[-_MAX_COMMANDS_SHOWN:]
    ]
    lines += [
        Text(f"now: {each.text}", STYLES[DisplayStatus.RUNNING])
        for each in moment.reports
        if each not in moment.commands
    ]
    tree = render(recorded.asset, moment.snapshot, height, notes)
    return Group(*lines, Text(), tree, Text(_SIGNS, "dim"))


def write_page(recording: Path, page: Path) -> None:
    """Write the HTML page of a recording.

    Raises:
        RecordingError: the file cannot be used as a recording.
        OSError: the page cannot be written.
    """
    recorded = RecordedMoments(recording)
    trees: list[list[Row]] = []
    commands: list[list[tuple[str, ...]]] = []
    moments = []
    for moment in recorded.moments:
        pose = moment.pose
        moments.append(
            {
                "time_s": round(moment.time_s, 3),
                "mode": moment.snapshot.mode,
                "why": moment.snapshot.why,
                "pose": pose and [round(x, 3) for x in (pose.x_m, pose.y_m, pose.heading_rad)],
                "tree": _retained_rows(trees, _rows(moment)),
                "commands": _retained_rows(
                    commands, [_report_cells(each) for each in moment.commands]
                ),
                "reports": [_report_cells(each) for each in moment.reports],
            }
        )
    run = {
        "title": f"{recorded.asset}: {recording.absolute().parent.name}/{recording.name}",
        "colours": {display.value: edge for display, (_, edge) in COLOURS.items()},
        "trees": trees,
        "commands": commands,
        "moments": moments,
    }
    text = json.dumps(run, ensure_ascii=False, separators=(",", ":")).replace("<", "\\u003c")
    frame = files("adapters.cli").joinpath("watch_page.html").read_text(encoding="utf-8")
    page.write_text(frame.replace("@RUN@", text), encoding="utf-8")


def _retained_rows(known: list[_Value], value: _Value) -> int:
    """Return the index of a value; successive equal values are stored once."""
    if not known or known[-1] != value:
        known.append(value)
    return len(known) - 1


def _rows(moment: Moment) -> list[Row]:
    nodes = moment.snapshot.nodes
    return [
        (branch, line(node, display), display.value, moment.since_s.get(node.path))
        for branch, node, display in zip(
            branches(nodes), nodes, display_statuses(nodes), strict=True
        )
    ]


def _report_cells(report: Report) -> tuple[str, ...]:
    stage = report.stage.name if report.stage is not None else report.severity.name
    return str(report.identity or ""), stage, report.text
