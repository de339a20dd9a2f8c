"""`rover demo --relay`, `--mocup` and `--assets`: every process of both links, and of the brick."""

import json
import re
from pathlib import Path

import pytest

from tests.demo.test_demo import Demo

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def ended(demo: Demo) -> str:
    """Return the output of a demonstration in which all goes as planned and nothing is left."""
    status, output = demo.end()
    assert status == 0, output
    assert [" ".join(process.cmdline()) for process in demo.others()] == []
    return output


def draws_a_timeline(folder: Path, output: str) -> bool:
    told = "each command between ground, orbiter and rover" in output
    return told and (folder / "timeline.png").stat().st_size > 0


def stages(folder: Path, link: str) -> dict[int, list[str]]:
    """Return the stages of each command that were told by a link, in their order."""
    told: dict[int, list[str]] = {}
    for line in (folder / "reports.jsonl").read_text().splitlines():
        report = json.loads(line)
        if report["link"] == link and report["stage"] not in (None, "PROGRESS"):
            told.setdefault(report["commandId"], []).append(report["stage"])
    return told


def test_a_rover_in_an_eclipse_and_another_beside_it_do_as_planned(tmp_path: Path) -> None:
    mocup = Demo("--mocup", "--out", str(tmp_path / "mocup"))
    output = ended(Demo("--relay", "--out", str(tmp_path / "relay")))
    assert draws_a_timeline(tmp_path / "relay", output)
    assert "no contact, next in" in output
    assert re.search("commands that waited at the orbiter  [23] of 6", output), output
    assert "its lifetime ended at the orbiter" in output
    ended(mocup)
    assert (tmp_path / "mocup" / "map.png").stat().st_size > 0
    assert (tmp_path / "mocup" / "nxt.log").is_file()


def test_what_is_asked_by_both_links_is_carried_out_once_by_either_rover(tmp_path: Path) -> None:
    output = ended(Demo("--assets", "--out", str(tmp_path / "run")))
    assert draws_a_timeline(tmp_path / "run", output)
    assert output.count("carried out once") == 2
    for asset in ("jackal", "mocup"):
        folder = tmp_path / "run" / asset
        assert (folder / "map.png").stat().st_size > 0
        direct, relay = stages(folder, "direct"), stages(folder, "relay")
        both = max(direct)
        assert direct[both].count("STARTED") == 1
        assert direct[both][-1] == relay[both][-1] == "EXECUTED"
