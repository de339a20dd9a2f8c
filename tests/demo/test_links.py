"""`rover demo --relay` and `--assets`: every process of both links, for one rover and for two."""

import json
from pathlib import Path

import pytest

from tests.demo.test_demo import Demo

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def played(what: str, folder: Path) -> str:
    """Play a demonstration in which all goes as planned and nothing is left; return its output."""
    demo = Demo(what, "--out", str(folder))
    status, output = demo.end()
    assert status == 0, output
    assert [" ".join(process.cmdline()) for process in demo.others()] == []
    assert (folder / "timeline.png").stat().st_size > 0
    assert "each command between ground, orbiter and rover" in output
    return output


def stages(folder: Path, link: str) -> dict[int, list[str]]:
    """Return the stages of each command that were told by a link, in their order."""
    told: dict[int, list[str]] = {}
    for line in (folder / "reports.jsonl").read_text().splitlines():
        report = json.loads(line)
        if report["link"] == link and report["stage"] not in (None, "PROGRESS"):
            told.setdefault(report["commandId"], []).append(report["stage"])
    return told


def test_what_waits_for_the_end_of_the_eclipse_is_carried_out(tmp_path: Path) -> None:
    output = played("--relay", tmp_path / "run")
    assert "no contact, next in" in output
    assert "commands that waited at the orbiter  2 of" in output
    assert "its lifetime ended at the orbiter" in output


def test_what_is_asked_by_both_links_is_carried_out_once_by_either_rover(tmp_path: Path) -> None:
    played("--assets", tmp_path / "run")
    for asset in ("jackal", "mocup"):
        folder = tmp_path / "run" / asset
        assert (folder / "map.png").stat().st_size > 0
        direct, relay = stages(folder, "direct"), stages(folder, "relay")
        both = max(direct)
        assert direct[both].count("STARTED") == 1
        assert direct[both][-1] == relay[both][-1] == "EXECUTED"
