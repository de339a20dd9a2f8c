"""Whether the benchmark of `rover whatif --save` finds a change that is not the minimal one."""

from pathlib import Path

import pytest

from sim.fork.candidates import candidate, speeds_of
from sim.fork.model import Fidelity
from sim.fork.save import SaveAnswer, Saving
from tests.benchmarks import saving


def test_another_change_than_the_minimal_one_is_counted_and_logged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    run = saving.failed_run("motion_held", ["settings.drive.travel_speed=0.4"])
    assert run is not None
    minimal = candidate([*speeds_of(run.settings)][:1], 1.1)
    named = iter([minimal.text, "drive.travel_speed=0.1 (recorded 0.4)"])

    def named_change(path: Path, seeds: range) -> SaveAnswer:
        assert path.is_file()
        found = Saving(next(named), len(seeds), 0, len(seeds), "")
        return SaveAnswer(str(path), "MOE:1", Fidelity.BIT_EQUAL, (), found)

    monkeypatch.setattr(saving, "failed_runs", lambda number, _: [run] * number)
    monkeypatch.setattr(saving, "brute_force", lambda *_: (minimal, 2))
    monkeypatch.setattr(saving, "save", named_change)
    logged: list[str] = []
    figures = {each.name: each for each in saving.measure(2, 2, 1, logged.append)}
    assert figures["same change and share"].value == 50
    assert not figures["same change and share"].met
    assert figures["runs that a change saves"].value == 100
    assert ["not as by" in each for each in logged] == [False, True]
