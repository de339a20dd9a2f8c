"""The section `navigation` of an asset, and what a recording holds of a navigation."""

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from adapters.recording import RunFile
from adapters.recording.messages import decode, encode, topic_of
from adapters.recording.run_file import RunReader
from executive.commands import MoveTo, Waypoint
from executive.commands.intake import check_arguments
from executive.core.recorder import recorded_ports
from executive.core.recording import (
    FactObserved,
    Item,
    NavigationCancelled,
    NavigationCommanded,
    NavigationGateChanged,
    PathRequested,
    ProcessStart,
)
from executive.settings import (
    Controller,
    LocomotionKind,
    MuxEntry,
    NavigationGate,
    NavigationSettings,
    Settings,
    load_settings,
)
from executive.values.facts import (
    Fact,
    NavigationFeedback,
    NavigationState,
    NavigationStatus,
    NavigationVelocity,
    PlannedPath,
)
from executive.values.geometry import Point, Pose, TargetFrame, Velocity
from executive.values.ports import (
    DriveBy,
    NavigateTo,
    NavigationGoal,
    NavigationRover,
    PathRequest,
    TurnBy,
)
from executive.values.reasons import Reason
from executive.values.reports import Identity
from tests.support.kinematic import KinematicRover

JACKAL = load_settings("jackal")
LOCK = NavigationSettings(NavigationGate.LOCK, "navigation", "navigation")
TOPIC, GATE = MuxEntry("nav_vel", 0.5, 0), MuxEntry("nav_lock", 0.2, 1)
RELAY = NavigationSettings(NavigationGate.RELAY)


def settings(
    navigation: NavigationSettings | None = LOCK,
    topic: MuxEntry | None = TOPIC,
    lock: MuxEntry | None = GATE,
    **others: Any,
) -> Settings:
    """Return the settings of a Jackal with a navigation behind the lock of its mux."""
    mux = JACKAL.mux
    assert mux is not None
    topics = mux.topics if topic is None else mux.topics | {"navigation": topic}
    locks = mux.locks if lock is None else mux.locks | {"navigation": lock}
    changed = {"mux": replace(mux, topics=topics, locks=locks), **others}
    return replace(JACKAL, navigation=navigation, **changed)


def test_a_gate_that_shuts_the_navigation_off_and_nothing_else_is_accepted() -> None:
    assert settings().offers_navigation
    assert settings(RELAY, mux=None).offers_navigation
    hidden = replace(LOCK, selectable=False)
    assert not settings(hidden).offers_navigation
    assert settings(hidden, controller=Controller.NAVIGATION).offers_navigation
    assert not JACKAL.offers_navigation


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"navigation": None, "controller": Controller.NAVIGATION}, "needs the section navigation"),
        ({"mux": None}, "add the section mux"),
        ({"topic": None}, "navigation.input navigation or .* not in the mux: known are stop,"),
        ({"lock": None}, "navigation.lock navigation is not in the mux: .*, e_stop"),
        ({"lock": MuxEntry("nav_lock", 0.0, 1)}, "timeout 0: above 0"),
        ({"lock": MuxEntry("nav_lock", 0.6, 1)}, "timeout 0.6: .* at most 0.5 s"),
        ({"lock": MuxEntry("nav_lock", 0.2, 0)}, "priority 0: it must be above 0"),
        ({"lock": MuxEntry("nav_lock", 0.2, 2)}, "at most 1, so that it masks no other input"),
        ({"topic": MuxEntry("nav_vel", 0.5, 7)}, "must be above 7"),
        ({"navigation": replace(LOCK, input="executive")}, "are those of the executive"),
        ({"navigation": replace(LOCK, lock="e_stop")}, "are those of the executive"),
    ],
)
def test_settings_of_a_gate_without_effect_are_refused(changed: dict[str, Any], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        settings(**changed)


def test_names_and_figures_of_the_gate_are_checked() -> None:
    with pytest.raises(ValueError, match="input and lock, the navigation's in the mux, are needed"):
        NavigationSettings(NavigationGate.LOCK, "navigation")
    with pytest.raises(ValueError, match="not known if it is relay"):
        NavigationSettings(NavigationGate.RELAY, lock="navigation")
    with pytest.raises(ValueError, match="finish_within_m"):
        replace(RELAY, finish_within_m=0.0)
    mocup = load_settings("mocup")
    with pytest.raises(ValueError, match="navigation needs locomotion velocity, not delegated"):
        replace(mocup, navigation=RELAY)
    assert mocup.locomotion is LocomotionKind.DELEGATED


def test_a_command_chooses_the_navigation_where_it_is_offered() -> None:
    request = MoveTo(Waypoint(1.0, 0.0), Controller.NAVIGATION)
    assert check_arguments(request, settings(), Point(0.0, 0.0)) is None
    refusal = check_arguments(request, JACKAL, Point(0.0, 0.0))
    assert refusal is not None
    assert refusal.reason is Reason.NOT_SUPPORTED
    assert "add the section navigation" in refusal.text


GOAL = NavigationGoal(
    3, NavigateTo((Pose(1.0, 2.0), Pose(3.0)), TargetFrame.MAP), Identity("MOE", 1)
)
FACTS: tuple[Fact, ...] = (
    NavigationStatus(3, NavigationState.ABORTED, 208, "NO_VALID_PATH", "no path", (0, 2)),
    NavigationFeedback(3, 1.5, 2, 1),
    NavigationFeedback(3, None),
    NavigationVelocity(Velocity(0.3, -0.1)),
    PlannedPath(1, (Point(0.0, 0.0), Point(1.0, 1.0))),
    PlannedPath(2, (), "no path"),
)
REQUEST = PathRequest(1, Pose(), Pose(1.0), TargetFrame.ODOM)
DECISIONS: tuple[Item, ...] = (
    NavigationCommanded(GOAL),
    NavigationCommanded(replace(GOAL, task=TurnBy(1.5, 0.5))),
    NavigationCommanded(replace(GOAL, task=DriveBy(-0.5, 0.3))),
    NavigationCancelled(),
    NavigationGateChanged(True),
    PathRequested(REQUEST),
)


@pytest.mark.parametrize("item", [*(FactObserved(1.0, 2.0, each) for each in FACTS), *DECISIONS])
def test_a_recording_holds_facts_and_commands_of_a_navigation(item: Item) -> None:
    assert decode(topic_of(item), encode(item)) == item


class Gated(KinematicRover):
    """A rover that notes the calls of its navigation."""

    calls: tuple[object, ...] = ()

    def navigate(self, goal: NavigationGoal) -> None:
        self.calls = (*self.calls, goal)

    def cancel_navigation(self) -> None:
        self.calls = (*self.calls, "cancel")

    def open_gate(self, is_open: bool) -> None:
        self.calls = (*self.calls, is_open)

    def plan_path(self, request: PathRequest) -> None:
        self.calls = (*self.calls, request)


class Tape:
    """Keeps the items of a recording."""

    def __init__(self) -> None:
        self.items: list[Item] = []

    def put(self, item: Item) -> None:
        self.items.append(item)


def test_the_calls_of_a_navigation_pass_the_tape_and_the_gate_on_change() -> None:
    rover, tape = Gated(), Tape()
    recorded = recorded_ports(tape, settings(), rover, (), None, None)[0]
    assert isinstance(recorded, NavigationRover)
    for is_open in (False, False, True):
        recorded.open_gate(is_open)
    recorded.navigate(GOAL)
    recorded.cancel_navigation()
    recorded.plan_path(REQUEST)
    assert rover.calls == (False, False, True, GOAL, "cancel", REQUEST)
    assert tape.items == [
        NavigationGateChanged(False),
        NavigationGateChanged(True),
        NavigationCommanded(GOAL),
        NavigationCancelled(),
        PathRequested(REQUEST),
    ]
    plain = recorded_ports(tape, JACKAL, rover, (), None, None)[0]
    assert not isinstance(plain, NavigationRover)


def test_the_settings_of_a_navigation_are_recorded(tmp_path: Path) -> None:
    with closing(RunFile(tmp_path / "run.mcap")) as tape:
        tape.put(ProcessStart(settings(), b"", b"", (), None, False))
    reader = RunReader(tmp_path / "run.mcap")
    (start,) = (reader.decoded(each) for each in reader.messages())
    assert start.settings == settings()
