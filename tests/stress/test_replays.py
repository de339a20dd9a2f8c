"""Recorded runs are replayed equally; a core that decides otherwise than recorded is found out."""

import pytest

from executive.motion.velocity_control import DriveLaw
from tests.stress import replays

FAULT = "replays: recordings that decide otherwise"


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(replays, "MAX_DURATION_S", 10.0)


def test_runs_of_all_kinds_are_replayed_equally() -> None:
    figures = replays.measure(2, 1, print)
    assert [figure.name for figure in figures if figure.met is False] == []
    assert {figure.name: figure.value for figure in figures}["replays: ticks"] > 100


def test_another_law_in_the_run_than_in_its_replay_is_found_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(DriveLaw, "done", property(lambda _: True))
    reported: list[str] = []
    figures = {figure.name: figure for figure in replays.measure(1, 1, reported.append)}
    assert figures[FAULT].value > 0
    assert reported[0].startswith("recordings that decide otherwise: run ")
