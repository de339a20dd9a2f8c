"""`rover demo --relay`, `--mocup` and `--assets`: every process of both links, and of the brick."""

import json
import re
from pathlib import Path

import pytest

from tests.demo.conftest import Played
from tests.demo.playing import Demo, Ran

pytestmark = [pytest.mark.ros, pytest.mark.slow]


def went_well(ran: Ran) -> bool:
    """Return whether all went as planned and nothing is left."""
    assert ran.status == 0, ran.output
    return ran.left == []


def draws_a_timeline(ran: Ran) -> bool:
    told = "each command between ground, orbiter and rover" in ran.output
    return told and (ran.folder / "timeline.png").stat().st_size > 0


def stages(folder: Path, link: str) -> dict[int, list[str]]:
    """Return the stages of each command that were told by a link, in their order."""
    told: dict[int, list[str]] = {}
    for line in (folder / "reports.jsonl").read_text().splitlines():
        report = json.loads(line)
        if report["link"] == link and report["stage"] not in (None, "PROGRESS"):
            told.setdefault(report["commandId"], []).append(report["stage"])
    return told


def test_a_rover_in_an_eclipse_does_as_planned(played: Played) -> None:
    ran = played.relay
    assert went_well(ran)
    assert draws_a_timeline(ran)
    assert "no contact, next in" in ran.output
    assert re.search("commands that waited at the orbiter  [23] of 6", ran.output), ran.output
    assert "its lifetime ended at the orbiter" in ran.output


def test_mocup_does_as_planned(played: Played) -> None:
    ran = played.mocup
    assert went_well(ran)
    assert (ran.folder / "map.png").stat().st_size > 0
    assert (ran.folder / "nxt.log").is_file()


def test_what_is_asked_by_both_links_is_carried_out_once_by_either_rover(tmp_path: Path) -> None:
    ran = Demo(tmp_path / "run", "--assets").ran()
    assert went_well(ran)
    assert draws_a_timeline(ran)
    assert ran.output.count("carried out once") == 2
    for asset in ("jackal", "mocup"):
        folder = ran.folder / asset
        assert (folder / "map.png").stat().st_size > 0
        direct, relay = stages(folder, "direct"), stages(folder, "relay")
        both = max(direct)
        assert direct[both].count("STARTED") == 1
        assert direct[both][-1] == relay[both][-1] == "EXECUTED"
