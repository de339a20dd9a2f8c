"""The examples of docs/campaigns.md: the file can be read, the script reads a data set."""

import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from sim.campaign.commands import campaign
from sim.campaign.reading import load_campaign
from tests.docs.pages import CHECKOUT, blocks
from tests.support.processes import run_to_end

PAGE = CHECKOUT / "docs" / "campaigns.md"


@pytest.mark.slow
def test_the_campaign_is_one_and_its_data_set_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole, sensors, faults = blocks(PAGE, "yaml")
    Path("my.yaml").write_text(whole)
    assert load_campaign("my.yaml").runs == 500
    before, _, after = whole.partition("  inject:")
    Path("grid.yaml").write_text(before + sensors + faults + "hold:" + after.partition("hold:")[2])
    assert load_campaign("grid.yaml").combinations == 9

    options = ["--runs", "2", "--jobs", "1", "--out", "runs/first-try"]
    played = CliRunner().invoke(campaign, ["my.yaml", *options])
    assert played.exit_code in (1, 2), played.output  # too few runs to say anything
    (script,) = blocks(PAGE, "python")
    ran = run_to_end(sys.executable, "-c", script)
    assert ran.stdout.startswith("2 runs, "), ran.stderr
