"""The answer to a what-if question as lines of text, and as plots side by side."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from io import BytesIO
from itertools import chain
from math import degrees
from pathlib import Path
from textwrap import shorten
from typing import Final

from PIL import Image

from executive.commands import declaration_of
from executive.values.geometry import Pose
from sim.drawing import as_png, draw_run, plot_of
from sim.fork.model import Change, CommandOutcome, Fidelity, FirstDifference, ForkOutcome, WhatIf

MAX_TITLE_LENGTH: Final = 80


def answer_lines(answer: WhatIf, changes: Change) -> Iterator[str]:
    """Yield the answer to a question, with its change."""
    change = change_text(changes)
    recorded, unchanged = answer.recorded, answer.unchanged
    yield from recorded.lacks
    if answer.fidelity is Fidelity.DIFFERENT:
        yield "without a change the fork does not reproduce the recording: there is no answer"
        yield from _difference(unchanged.first_difference)
        yield from _commands(recorded, [unchanged], "without a change")
        return
    if answer.fidelity is Fidelity.NOT_COMPARED:
        yield "without a change: not compared, the fork begins at the end of the recording"
    else:
        off = "" if answer.fidelity is Fidelity.BIT_EQUAL else _apart(recorded.pose, unchanged.pose)
        yield f"without a change: as recorded ({answer.fidelity.value}{off})"
    if not answer.forks:
        return
    differences = [each.first_difference for each in answer.forks if each.first_difference]
    if not differences:
        yield f"{change}: no decision differs until the end of the recording"
        if all(each.kinds == recorded.kinds for each in answer.forks):
            return
    exact = answer.fidelity is Fidelity.BIT_EQUAL
    yield from _difference(next(iter(differences), None), "recorded" if exact else "unchanged")
    yield from _commands(recorded, answer.forks, change)
    for name, run in (("recorded", unchanged), (change, answer.forks[0])):
        contacts = "" if run.contacts is None else f", {run.contacts} contacts"
        yield f"end {name}: {_pose(run.pose)} after {run.end_s:.1f} s{contacts}"


def change_text(change: Change) -> str:
    """Return a change as text."""
    return ", ".join(_changes(change))


def write_plots(recording: Path, forked: Path, change: Change, path: Path) -> None:
    """Write the plots of a recording and of its fork side by side, as PNG.

    Raises:
        RecordingError: a file cannot be used as a recording.
        OSError: the picture cannot be written.
    """
    halves = []
    for file, name in ((recording, "recorded"), (forked, change_text(change))):
        plot, title = plot_of(file), shorten(name, MAX_TITLE_LENGTH, placeholder="…")
        titled = replace(plot, timeline=replace(plot.timeline, title=title))
        halves.append(Image.open(BytesIO(as_png(draw_run(titled)))))
    left, right = halves
    beside = Image.new("RGB", (left.width + right.width, max(left.height, right.height)), "white")
    beside.paste(left, (0, 0))
    beside.paste(right, (left.width, 0))
    beside.save(path)


def _changes(change: Change) -> Iterator[str]:
    yield from (f"with {each}" for each in change.settings)
    if change.controller is not None:
        yield f"with {change.controller.value}"
    if change.world is not None:
        yield f"in {change.world.name}"
    if change.scans:
        yield "among the measured obstacles"
    yield from (f"with {declaration_of(type(each.request)).name}" for each in change.added)
    yield from (f"without {each}" for each in (*change.dropped, *change.without))


def _difference(difference: FirstDifference | None, other: str = "recorded") -> Iterator[str]:
    if difference is None:
        return
    yield f"first different decision after {difference.time_s:.2f} s: {difference.forked}"
    yield f"  {other}: {difference.recorded}"
    if difference.forked_why:
        yield f"  why: {difference.forked_why}"
    if difference.recorded_why not in ("", difference.forked_why):
        yield f"  why recorded: {difference.recorded_why}"


def _commands(recorded: ForkOutcome, forks: Sequence[ForkOutcome], change: str) -> Iterator[str]:
    then = {each.command: each for each in recorded.commands}
    names = {each.command: each.name for each in chain(*(run.commands for run in forks))}
    for command in dict.fromkeys([*then, *names]):
        before = _end(then[command], [then[command].end_s]) if command in then else "not sent"
        name = names.get(command) or then[command].name
        found: dict[tuple[str, str], list[CommandOutcome]] = {}
        for each in chain(*(run.commands for run in forks)):
            if each.command == command:
                found.setdefault((each.stage, each.reason), []).append(each)
        ends = [
            _end(group[0], [each.end_s for each in group])
            + (f" in {len(group)} of {len(forks)}" if len(forks) > 1 else "")
            for group in found.values()
        ]
        yield f"{command} {name}: recorded {before}; {change} {', '.join(ends) or 'not sent'}"


def _end(outcome: CommandOutcome, ends_s: Sequence[float]) -> str:
    low, high = f"{min(ends_s):.2f}", f"{max(ends_s):.2f}"
    when = low if low == high else f"{low} .. {high}"
    return f"{outcome.stage} {when} s {outcome.reason}".rstrip()


def _pose(pose: Pose | None) -> str:
    if pose is None:
        return "at an unknown pose"
    return f"x {pose.x_m:.2f} m, y {pose.y_m:.2f} m, heading {degrees(pose.heading_rad):.0f}°"


def _apart(then: Pose | None, now: Pose | None) -> str:
    if then is None or now is None or then == now:
        return ""
    return f", end {1000 * then.point.distance_m(now.point):.0f} mm off"
