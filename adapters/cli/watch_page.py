"""Writes a recorded run as one HTML page with a time slider; it needs no network."""

import json
from importlib.resources import files
from pathlib import Path
from typing import TypeVar

from adapters.recording import Moment, RecordedMoments
from executive.values.reports import Report
from trees import COLOURS, branches, display_statuses, line

Row = tuple[str, str, str, float | None]
"""A row of a tree: branch, node, display style, start of its status in s."""
_Value = TypeVar("_Value")


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
                "told": [_report_cells(each) for each in moment.reports],
            }
        )
    run = {
        "title": f"{recorded.asset}: {recording.absolute().parent.name}/{recording.name}",
        "looks": {display.value: edge for display, (_, edge) in COLOURS.items()},
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
