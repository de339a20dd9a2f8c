"""Both ends of the relay attached to daemons, as their settings files say it."""

import asyncio
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from adapters.bundle import BundleError, ContactOverride, IonSettings
from adapters.bundle.node.settings import DaemonLink
from adapters.mops import decode
from adapters.relay.orbiter import load_orbiter
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.rover import load_relay
from executive.commands.catalogue import Command, MoveForward
from executive.settings import SettingsError
from executive.values.parameters import ParameterValue
from executive.values.reports import Identity, Report, ReportKind
from tests.bundle.ion_node import ion_nodes
from tests.bundle.worlds import ONE, TWO
from tests.docs.pages import CHECKOUT, blocks
from tests.relay.rover.ends import DICTIONARY, Rover, bridge_of, event, until

RELAY = {"asset": "JACKAL", "eid": str(TWO), "orbiter": {"eid": str(ONE)}, "health_interval_s": 60}
ROVER = {
    "asset": "jackal",
    "description": "through a daemon",
    "domain": ["meteron", "jackal"],
    "eid": str(TWO),
    "port": 0,
}
ORBITER = {"eid": str(ONE), "rovers": [ROVER]}


class Ground:
    """Who listens at the orbiter."""

    def __init__(self) -> None:
        self.output: list[str] = []

    def on_report(self, report: Report, cursor: int | None) -> None:
        if report.kind is ReportKind.EVENT:
            self.output.append(report.text)

    def on_telemetry(self, values: Sequence[ParameterValue]) -> None:
        raise AssertionError("nobody measures anything")


def written(folder: Path, name: str, **settings: object) -> Path:
    path = folder / name
    path.write_text(yaml.safe_dump(settings))
    return path


async def test_a_command_is_uplinked_and_a_report_downlinked_by_daemons(tmp_path: Path) -> None:
    async with ion_nodes(tmp_path, 1, 2):
        above = load_orbiter(written(tmp_path, "orbiter.yaml", **ORBITER, agent="ion"))
        aboard, _ = load_relay(
            "jackal", written(tmp_path, "jackal.relay.yaml", **RELAY, agent="ion")
        )
        topics, relay = Rover(), OrbiterRelay(above, tmp_path / "above", lambda: None, DICTIONARY)
        link = bridge_of(aboard, tmp_path / "aboard.db", topics)
        await relay.open()
        await asyncio.to_thread(link.start)
        receiving = asyncio.create_task(relay.receive())
        try:
            (rover,) = relay.rovers.values()
            rover.listener = ground = Ground()
            await rover.submit(Command(Identity("MOE", 7), MoveForward(1.0), "relay"))
            await until(lambda: bool(topics.commands))
            assert decode(topics.commands[0].encode()).moe_inputs_id == 7
            link.notify(str(event(1)))
            await until(lambda: len(topics.confirmed) == 1)
            await until(lambda: ground.output == ["near"])
        finally:
            receiving.cancel()
            await asyncio.to_thread(link.close)
            await asyncio.gather(receiving, return_exceptions=True)
            await relay.close()


def test_contacts_of_a_daemon_are_set_there(tmp_path: Path) -> None:
    settings = load_orbiter(written(tmp_path, "orbiter.yaml", **ORBITER, agent="ion"))
    relay = OrbiterRelay(settings, tmp_path, lambda: None, DICTIONARY)
    (node,) = relay.rovers
    with pytest.raises(BundleError, match="ionadmin"):
        relay.override_contact(node, ContactOverride.UP)


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ({"agent": "dtnd"}, "agent"),
        ({"agent": "aap2"}, "agent"),
        ({"ion": {"python": "x"}}, "there is a section ion"),
        ({}, "one of ltp, tcpcl, udp"),
    ],
)
def test_invalid_settings_are_reported(
    wrong: dict[str, object], fault: str, tmp_path: Path
) -> None:
    with pytest.raises(SettingsError, match=fault):
        load_relay("jackal", written(tmp_path, "jackal.relay.yaml", **RELAY, **wrong))
    with pytest.raises(SettingsError, match=fault):
        load_orbiter(written(tmp_path, "orbiter.yaml", **ORBITER, **wrong))


def test_a_link_and_a_daemon_are_one_too_many(tmp_path: Path) -> None:
    ltp = {"ltp": {"address": {"host": "127.0.0.1", "port": 1113}}}
    relay = {**RELAY, "orbiter": {"eid": str(ONE), **ltp}, "agent": "ion"}
    with pytest.raises(SettingsError, match="remove ltp of orbiter, and section listen"):
        load_relay("jackal", written(tmp_path, "jackal.relay.yaml", **relay))


def test_the_settings_in_the_documentation_are_settings(tmp_path: Path) -> None:
    page = CHECKOUT / "docs" / "relay.md"
    (example,) = [block for block in blocks(page, "yaml") if "agent: " in block]
    path = tmp_path / "jackal.relay.yaml"
    path.write_text(example)
    settings, _ = load_relay("jackal", path)
    assert isinstance(settings.daemon, IonSettings)
    assert settings.node().neighbours[0].link == DaemonLink(ONE)
