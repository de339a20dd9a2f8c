"""Missions that are killed continue as if they were not, and faults of this are found."""

from collections.abc import Callable
from typing import Any

import pytest

from executive.core.plan_surroundings import RoverSurroundings
from executive.plans import planner, recovery
from executive.plans.state import decode, encode
from executive.record import PlanStore, StoredState
from tests.stress.plan_causes import Held, check_causes
from tests.stress.plan_kills import Broken, Kill, kill_missions
from tests.support.examples import ALL
from tests.support.mission_bench import SITUATIONS, Situation

SHORT = ("stake", "stow, a picture fails", "night, cold")
FURTHER = ("passes", "marks, no answer")


def situations(*names: str) -> list[Situation]:
    return [each for each in SITUATIONS if each.name in names]


def test_missions_continue_over_kills() -> None:
    found: list[str] = []
    killed = situations(*SHORT, *(FURTHER if ALL else ()))
    findings, kills = kill_missions(12, 1, lambda line: found.append(str(line)), killed)
    assert not findings.counts, found
    assert set(kills) >= set(Kill) - {Kill.REAL}


def test_each_mission_is_killed() -> None:
    assert {each.file for each in SITUATIONS} == {f"{number:02}" for number in range(1, 13)}


def forgets_ended_commands(store: PlanStore, plan_id: str, *rest: Any) -> bool:
    """Recover a plan without the commands that have ended."""
    stored = store.state(plan_id)
    if stored is None:
        return False
    text = encode(decode(stored.text)._replace(commands=()))
    store.save_state(plan_id, StoredState(stored.digest, rest[0], True, text))
    return False


def stops_no_timer(recover: Callable[..., bool]) -> Callable[..., bool]:
    def recover_late(store: PlanStore, plan_id: str, utc_s: float, resumes: bool) -> bool:
        return recover(store, plan_id, utc_s + 100.0, resumes)

    return recover_late


def test_a_step_done_again_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "recover_state", forgets_ended_commands)
    findings, _ = kill_missions(12, 1, lambda _: None, situations("stow"))
    assert findings.counts[Broken.COMMANDS]


def test_a_sleep_of_another_length_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planner, "recover_state", stops_no_timer(recovery.recover_state))
    findings, _ = kill_missions(12, 1, lambda _: None, situations("stake"))
    assert findings.counts[Broken.WAITS]


def test_a_command_without_its_state_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    save_state = PlanStore.save_state

    def save_late(self: PlanStore, plan_id: str, state: StoredState) -> None:
        self.__dict__.setdefault("late", []).append(state)
        for each in self.__dict__["late"][-2:-1]:
            save_state(self, plan_id, each)

    monkeypatch.setattr(PlanStore, "save_state", save_late)
    findings, _ = kill_missions(12, 1, lambda _: None, situations("stow"))
    assert findings.counts


def test_no_mission_continues_by_itself_after_another_cause(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found: list[str] = []
    short = situations("stow")
    findings, kills = check_causes(1, lambda line: found.append(str(line)), short)
    assert not findings.counts, found
    assert kills == 5
    monkeypatch.setattr(planner.Planner, "_await_operators", lambda _: None)
    monkeypatch.setattr(RoverSurroundings, "is_held", False)
    findings, _ = check_causes(1, lambda _: None, situations("stow"))
    assert findings.counts[Held.CONTINUES]
