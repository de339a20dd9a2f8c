"""Whether a scenario can be played in a certain way: not each has all that a file can say."""

from collections.abc import Iterator
from typing import Final

from sim.scenario.expectations import (
    Expectation,
    FileFetched,
    FileLife,
    FileList,
    LinkTells,
    PlanIs,
    VideoComes,
)
from sim.scenario.how import How
from sim.scenario.model import Clear, Crash, Eclipse, Entry, Fetch, Inject, Repeat, Scenario, Send
from sim.scenario.strict import FormatError

_LOCK_STEP_ONLY: Final = (Inject, Clear, Crash)
_NOT_BY_RELAY: Final = (FileLife, FileList, FileFetched, VideoComes, PlanIs)


def check_how(scenario: Scenario, how: How) -> None:
    """Look for what cannot be played this way.

    Raises:
        FormatError: there is such an entry or expectation.
    """
    for index, entry in enumerate(scenario.timeline):
        for key, text in _entry_faults(entry, how):
            raise FormatError(f"timeline[{index}]{key}", text)
    for index, expected in enumerate(scenario.expect):
        for key, text in _expectation_faults(expected, how):
            raise FormatError(f"expect[{index}]{key}", text)


def _entry_faults(entry: Entry, how: How) -> Iterator[tuple[str, str]]:
    if how is How.LOCK_STEP:
        return
    if isinstance(entry, _LOCK_STEP_ONLY):
        yield "", f"{type(entry).__name__.lower()} works in lock step only"
    if isinstance(entry, Send | Repeat) and entry.link not in {None, how.link}:
        yield ".link", f"{entry.link!r} works in lock step only"
    if how is not How.RELAY:
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


def _expectation_faults(expected: Expectation, how: How) -> Iterator[tuple[str, str]]:
    if how is How.LOCK_STEP and isinstance(expected, VideoComes):
        yield ".video", "video works with --live only"
    if how is not How.RELAY and isinstance(expected, LinkTells):
        yield ".link", "works with --live --link relay only"
    if how is not How.RELAY:
        return
    if isinstance(expected, _NOT_BY_RELAY):
        yield f".{next(iter(expected.__slots__))}", "does not travel by the relay"
