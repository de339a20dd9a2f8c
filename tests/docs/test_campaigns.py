"""The examples of docs/campaigns.md: the file is played by its commands, the script reads that."""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from pathlib import Path

import pytest

from sim.campaign.cluster import J, R
from sim.campaign.reading import load_campaign
from tests.docs.pages import CHECKOUT, blocks, lines
from tests.docs.test_commands import Desk, laid_out
from tests.support.processes import run_to_end

PAGE = CHECKOUT / "docs" / "campaigns.md"
IDLE_LIMIT_S = 3600.0
"""The suite runs these tests while a processor is idle: they may wait for long."""


def played_here(_: object, play: Callable[[J], R], jobs: Iterable[J]) -> Iterator[R]:
    return map(play, jobs)


@pytest.mark.slow
def test_the_campaign_is_played_and_its_data_set_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole, sensors, faults = blocks(PAGE, "yaml")
    Path("my.yaml").write_text(whole)
    assert load_campaign("my.yaml").runs == 500
    before, _, after = whole.partition("  inject:")
    Path("grid.yaml").write_text(
        before + sensors + faults + "criteria:" + after.partition("criteria:")[2]
    )
    assert load_campaign("grid.yaml").combinations == 9

    # The clusters are in tests/campaign; here, each of their processes would import for longer than
    # it plays.
    monkeypatch.setattr("sim.campaign.cluster.local_cluster", lambda _: nullcontext())
    monkeypatch.setattr("sim.campaign.cluster.results", played_here)
    desk = Desk(laid_out(tmp_path), {})
    for line in lines(PAGE):
        desk.run(line)
    (script,) = blocks(PAGE, "python")
    ran = run_to_end(sys.executable, "-c", script, timeout_s=IDLE_LIMIT_S)
    assert ran.stdout.startswith("3 runs, "), ran.stderr
