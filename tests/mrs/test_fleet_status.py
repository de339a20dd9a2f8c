"""`rover status` on other rovers, as typed."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from adapters.cli.main import main
from executive.commands.catalogue import SetTravelSpeed
from tests.mrs.fleet import Fleet, eventually, value

USAGE = 2


@pytest.fixture
def uri(tmp_path: Path) -> Iterator[str]:
    """Give the address of a rover that heard another."""
    fleet = Fleet(tmp_path)
    jackal = fleet.launch("jackal")
    fleet.launch("scout", above=jackal).carry_out(SetTravelSpeed(0.25))
    eventually(lambda: value(jackal, "scout", "TRAVEL_SPEED") == 0.25)
    yield jackal.uri
    fleet.close_all()


def status(*arguments: str) -> Result:
    return CliRunner().invoke(main, ("status", *arguments))


def test_lists_the_rovers_and_shows_one(uri: str) -> None:
    listed = status("--to", uri, "--assets")
    assert listed.exit_code == 0, listed.output
    assert [line.split()[:2] for line in listed.output.splitlines() if "IDLE" in line] == [
        ["jackal", "IDLE"],
        ["scout", "IDLE"],
    ]
    assert "Clearpath Jackal" in listed.output
    lines = status("--to", uri, "--assets", "--json").output.splitlines()
    assert [json.loads(line) for line in lines][1] == {"asset": "scout", "mode": "IDLE"}
    shown = status("--to", uri, "--asset", "scout")
    assert shown.exit_code == 0, shown.output
    assert ["TRAVEL_SPEED", "0.250", "m/s"] in [s.split()[:3] for s in shown.output.splitlines()]
    told = json.loads(status("--to", uri, "--asset", "scout", "--json").output)
    assert told["asset"] == "scout"
    assert told["parameters"]["TRAVEL_SPEED"]["value"] == 0.25


def test_says_who_was_not_heard_of(uri: str) -> None:
    result = status("--to", uri, "--asset", "mule")
    assert result.exit_code == USAGE
    assert "mule was not heard of" in result.output


@pytest.mark.parametrize(
    "arguments", [("--assets", "--asset", "scout"), ("--assets", "--watch"), ("--asset", "")]
)
def test_options_that_do_not_go_together_are_a_usage_error(
    uri: str, arguments: tuple[str, ...]
) -> None:
    assert status("--to", uri, *arguments).exit_code == USAGE
