"""Whether what a scenario says fits together, and whether it can be played in a certain mode.

Labels must be known and times reached; not each mode of playing has all that a file can say.
"""

import re
from collections.abc import Iterator
from dataclasses import fields
from typing import Final

from sim.rover.lockstep import STEP_S
from sim.scenario.expect_commands import (
    CommandLife,
    FileFetched,
    FileLife,
    FileList,
    LinkTells,
    PlanIs,
)
from sim.scenario.expect_rover import ParameterIs, VideoComes
from sim.scenario.model import (
    Ask,
    Clear,
    Crash,
    Eclipse,
    Entry,
    Expectation,
    Fetch,
    Inject,
    PlayMode,
    Repeat,
    Scenario,
    Send,
)
from sim.scenario.moments import Lasting, Timed
from sim.scenario.strict import FormatError

_LABEL: Final = re.compile(r"\S+")
_LARGEST_PX: Final = (1280, 960)


def check(scenario: Scenario) -> None:
    """Refuse what would fail during the run.

    Raises:
        FormatError: something does not fit; the text names the entry.
    """
    _check_settings(scenario)
    commands = _names(scenario, Send)
    questions = _names(scenario, Ask)
    fetched = frozenset(step.fetch for step in scenario.timeline if isinstance(step, Fetch))
    for path, entry in _timed(scenario):
        if entry.after is not None:
            _known(entry.after.label, commands, f"{path}.after")
        lasting_s = entry.for_s if isinstance(entry, Lasting) else 0.0
        if entry.at_s is not None and entry.at_s + lasting_s > scenario.lasts_s:
            raise FormatError(path, f"is later than the end, {scenario.lasts_s:g} s")
    for index, step in enumerate(scenario.timeline):
        if step.at_s is None and step.after is None:
            raise FormatError(f"timeline[{index}]", "at or after is needed")
        if isinstance(step, Repeat):
            _known(step.repeat, commands, f"timeline[{index}].repeat")
    for index, expected in enumerate(scenario.expect):
        if isinstance(expected, CommandLife):
            _known(expected.command, commands, f"expect[{index}].command")
        if isinstance(expected, FileFetched):
            _known(expected.fetched, fetched, f"expect[{index}].fetched")
        if isinstance(expected, ParameterIs | FileList) and expected.asked is not None:
            _known(expected.asked, questions, f"expect[{index}].asked")


def _check_settings(scenario: Scenario) -> None:
    settings = scenario.settings
    tick_s, drive, camera = settings.tick_s, settings.drive, settings.camera
    if not STEP_S <= tick_s <= 1 or abs(round(tick_s / STEP_S) * STEP_S - tick_s) > 1e-9:
        raise FormatError("settings.tick", f"{tick_s:g} s is no multiple of {STEP_S:g} s up to 1 s")
    figures = {f"drive.{each.name}": getattr(drive, each.name) for each in fields(drive)}
    for name, value in {**figures, "camera.rotate_speed_radps": camera.rotate_speed_radps}.items():
        if value <= 0:
            raise FormatError("settings", f"{name} {value:g} is not above 0")
    for path, size, largest in (
        ("width", camera.width_px, _LARGEST_PX[0]),
        ("height", camera.height_px, _LARGEST_PX[1]),
    ):
        if not 1 <= size <= largest:
            raise FormatError(f"settings.camera.{path}", f"{size} is not in 1 .. {largest}")


def _timed(scenario: Scenario) -> Iterator[tuple[str, Timed]]:
    for index, entry in enumerate(scenario.timeline):
        yield f"timeline[{index}]", entry
    for index, expected in enumerate(scenario.expect):
        if isinstance(expected, Timed):
            yield f"expect[{index}]", expected


def _names(scenario: Scenario, kind: type[Send] | type[Ask]) -> frozenset[str]:
    names: set[str] = set()
    for index, entry in enumerate(scenario.timeline):
        if not isinstance(entry, kind):
            continue
        name = entry.name if isinstance(entry, Send) else entry.ask
        if not _LABEL.fullmatch(name):
            raise FormatError(f"timeline[{index}]", f"{name!r} is no label: it has a space")
        if name in names:
            raise FormatError(f"timeline[{index}]", f"there is a {name!r} already: give it a label")
        names.add(name)
    return frozenset(names)


def _known(label: str, labels: frozenset[str], path: str) -> None:
    if label not in labels:
        raise FormatError(path, f"no {label!r} in timeline; known are {', '.join(sorted(labels))}")


_LOCK_STEP_ONLY: Final = (Inject, Clear, Crash)
_NOT_BY_RELAY: Final = (FileLife, FileList, FileFetched, VideoComes, PlanIs)


def check_play_mode(scenario: Scenario, mode: PlayMode) -> None:
    """Look for what cannot be played this way.

    Raises:
        FormatError: there is such an entry or expectation.
    """
    for index, entry in enumerate(scenario.timeline):
        for key, text in _entry_faults(entry, mode):
            raise FormatError(f"timeline[{index}]{key}", text)
    for index, expected in enumerate(scenario.expect):
        for key, text in _expectation_faults(expected, mode):
            raise FormatError(f"expect[{index}]{key}", text)


def _entry_faults(entry: Entry, mode: PlayMode) -> Iterator[tuple[str, str]]:
    if mode is PlayMode.LOCK_STEP:
        return
    if isinstance(entry, _LOCK_STEP_ONLY):
        yield "", f"{type(entry).__name__.lower()} works in lock step only"
    if isinstance(entry, Send | Repeat) and entry.link not in {None, mode.link}:
        yield ".link", f"{entry.link!r} works in lock step only"
    if mode is not PlayMode.RELAY:
        return
    if isinstance(entry, Fetch):
        yield "", "files do not travel by the relay"
    if isinstance(entry, Send) and entry.replace:
        yield ".replace", "commands by the relay wait their turn"
    if isinstance(entry, Eclipse):
        if entry.at_s is None:
            yield "", "by the relay an eclipse is planned: it needs at"
        elif not (entry.at_s.is_integer() and entry.eclipse_s.is_integer()):
            yield "", "by the relay an eclipse begins and ends at whole seconds"


def _expectation_faults(expected: Expectation, mode: PlayMode) -> Iterator[tuple[str, str]]:
    if mode is PlayMode.LOCK_STEP and isinstance(expected, VideoComes):
        yield ".video", "video works with --live only"
    if mode is not PlayMode.RELAY and isinstance(expected, LinkTells):
        yield ".link", "works with --live --link relay only"
    if mode is not PlayMode.RELAY:
        return
    if isinstance(expected, _NOT_BY_RELAY):
        yield f".{next(iter(expected.__slots__))}", "does not travel by the relay"
