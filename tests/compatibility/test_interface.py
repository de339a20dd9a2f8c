"""Commands, options, names, numbers, settings and messages of earlier versions are understood."""

import json
import tomllib
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from adapters.mal.specification_xml import read_areas
from adapters.mops import load_dictionary
from adapters.mrs.spec import mrs_specification
from adapters.relay.orbiter.settings import load_orbiter
from adapters.relay.rover.settings import load_relay
from executive.commands import Mode, PlanDefinition
from executive.plans import FORMAT, read_plan
from executive.record import digest
from executive.settings import config_folder, load_settings, names_in, unstructure
from executive.values.reasons import Refusal
from sim.campaign.reading import load_campaign
from sim.rover import load_world
from sim.scenario.reading import load_scenario
from tests.compatibility.conftest import HERE, VERSIONS
from tests.compatibility.interface import (
    REQUIRED,
    changes,
    command_line,
    public_interface,
    python,
    services,
)
from tests.compatibility.messages import command as command_of
from tests.compatibility.messages import (
    decoded_reports,
    encoded_reports,
    from_mal,
    from_mops,
    mal_octets,
    mops_values,
)

REMOVED = tomllib.loads((HERE / "removed.toml").read_text(encoding="utf-8"))
SLOW = ("faults", "after_faults")
"""Campaigns that take a second to read, with no key that others do not have."""
PROCEED = (
    "programs of users break by this. Keep the old name beside the new one, with a deprecation"
    " (docs/compatibility.md), or write the lines into tests/compatibility/removed.toml with the"
    " version that warned of them"
)


def plain(value: Any) -> Any:
    """Return what JSON makes of a value."""
    return json.loads(json.dumps(value, default=str))


def shape(value: Any) -> Any:
    """Return plain data with the names of their types in place of the values."""
    if isinstance(value, dict):
        return {key: shape(part) for key, part in value.items()}
    if isinstance(value, list):
        return [shape(part) for part in value]
    return type(value).__name__


def test_the_interface_has_all_that_it_had(version: Path) -> None:
    before = json.loads((version / "interface.json").read_text(encoding="utf-8"))
    found = list(changes(before, plain(public_interface())))
    assert not [each for each in found if each not in REMOVED], PROCEED


def test_removals_were_deprecated_in_a_release() -> None:
    assert set(REMOVED.values()) <= set(VERSIONS)


@pytest.mark.parametrize(
    ("now", "expected"),
    [
        ({"a": {"b": 1, "c": 2}}, []),
        ({"a": {"c": 2}}, ["a b: is missing"]),
        ({"a": {"b": 2}}, ["a b: was 1, is 2"]),
        ({"a": {"b": 1, REQUIRED: ["x", "y"]}}, ["a: y is required"]),
        ({"a": {"b": 1, REQUIRED: []}}, []),
        ({"a": {"b": 1, "list": []}}, ["a list: one is missing"]),
    ],
)
def test_what_breaks_users_is_found(now: Any, expected: list[str]) -> None:
    before = {"a": {"b": 1, REQUIRED: ["x"], "list": ["one"]}}
    whole = {"a": {REQUIRED: ["x"], "list": ["one", "two"], **now["a"]}}
    assert list(changes(before, whole)) == expected


class Before:
    """Names as a release has them."""

    def __init__(self) -> None:
        self.holder = "MOE"

    @property
    def events(self) -> int:
        """Return their number."""
        return 1

    async def stop(self, after_s: float = 1.0) -> None:
        """Stop."""


class After:
    """The same names, incompatible."""

    def events(self) -> int:
        """Return their number."""
        return 1

    def stop(self, after_s: float = 9.0) -> None:
        """Stop."""


def test_a_changed_kind_or_default_of_a_python_name_is_found() -> None:
    assert list(changes(python(Before), python(Before))) == []
    assert list(changes(python(Before), python(After))) == [
        "holder: is missing",
        "events attribute: is missing",
        "stop default of (after_s): was 1.0, is 9.0",
        "stop async: was True, is False",
    ]


@pytest.mark.parametrize(
    ("before", "now"),
    [(None, 5), (Path("a"), Path("b")), (("a",), ("b",)), (Mode.IDLE, Mode.SAFE)],
)
def test_a_changed_default_of_an_option_is_found(before: Any, now: Any) -> None:
    def described(default: Any) -> Any:
        multiple = isinstance(default, tuple)
        option = click.Option(["--name"], default=default, multiple=multiple)
        return command_line(click.Command("do", params=[option]))

    assert list(changes(described(before), described(before))) == []
    assert len(list(changes(described(before), described(now)))) == 1


def test_the_services_have_all_that_they_had(left: Path) -> None:
    (before,) = read_areas(left / "mrs.xml")
    (now,) = (area for area in mrs_specification().areas if area.name == before.name)
    assert list(changes(plain(services(before)), plain(services(now)))) == []


def test_messages_have_the_same_octets(left: Path) -> None:
    dictionary = load_dictionary(left / "config" / "mops" / "dictionary.yaml")
    requests = json.loads((left / "requests.json").read_text(encoding="utf-8"))
    assert len(requests) > 20
    for name, encoded in requests.items():
        octets = bytes.fromhex(encoded["mal"])
        command = from_mal(octets)
        assert type(command.request).__name__ == name
        assert digest(command).hex() == encoded["digest"], "a repeat would be refused"
        assert mal_octets(command_of(command.request)) == octets
        if encoded["mops"] is not None:
            assert from_mops(encoded["mops"], dictionary) == command.request
    body = (left / "reports.mal").read_bytes()
    reports = decoded_reports(body)
    assert len(reports) > 20
    assert encoded_reports(reports) == body


def test_messages_of_the_relay_link_have_the_values_that_they_had(left: Path) -> None:
    replies = json.loads((left / "replies.json").read_text(encoding="utf-8"))
    assert len(replies) == 6
    for kind, before in replies.items():
        now = plain(mops_values(kind, before["text"], load_dictionary()))
        assert list(changes(before["values"], now)) == [], kind


def test_settings_are_read(left: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config, shipped = left / "config", config_folder()
    monkeypatch.setenv("ROVER_CONFIG", str(config))
    complete = config / "complete.yaml"
    before = yaml.safe_load(complete.read_text(encoding="utf-8"))
    assert list(changes(before, plain(unstructure(load_settings(str(complete)))))) == []
    for name in (*names_in(config), *(f"robots/{each}" for each in names_in(config / "robots"))):
        load_settings(name)
    for path in config.glob("*.relay.yaml"):
        load_relay(path.name.partition(".")[0], path)
    load_orbiter(config / "mops" / "orbiter.yaml")
    for path in config.glob("worlds/*.yaml"):
        load_world(path)
    for path in (*config.glob("scenarios/*.yaml"), *config.glob("demo/*.yaml")):
        load_scenario(str(path))
    for path in config.glob("campaigns/*.yaml"):
        if path.stem not in SLOW:
            load_campaign(str(path))
    for path in config.glob("plans/*.xml"):
        plan = PlanDefinition(path.stem, path.stem, FORMAT, path.read_bytes())
        assert not isinstance(read_plan(plan), Refusal), path
    for path in (*config.glob("*.ros.yaml"), *config.glob("*.nxt.yaml")):
        before, now = (
            yaml.safe_load((folder / path.name).read_text(encoding="utf-8"))
            for folder in (config, shipped)
        )
        assert list(changes(shape(before), shape(now))) == []
