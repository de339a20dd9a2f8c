"""`rover-mops` as a process that is killed, and started again on what it left."""

import asyncio
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.relay.orbiter import load_orbiter
from executive.commands.catalogue import MoveForward
from executive.settings import SettingsError
from tests.relay.orbiter.sky import LIMIT_S, STAGES, Sky, catch_up, landed
from tests.support.ports import free_port
from tests.support.processes import Running, running

SETTINGS = """
eid: ipn:1.1
listen: {{ltp: {{host: 127.0.0.1, port: {orbiter}}}}}
rovers:
  - asset: jackal
    description: Jackal
    domain: [meteron, jackal]
    eid: ipn:2.1
    ltp: {{address: {{host: 127.0.0.1, port: {rover}}}}}
    port: {port}
"""


class Orbiter:
    """The process, its settings and its data."""

    def __init__(self, folder: Path) -> None:
        self.sky = Sky(folder, "jackal")
        self.port = free_port(socket.SOCK_STREAM)
        self.settings = folder / "relay.yaml"
        self._starts = 0

    @contextmanager
    def serving(self, *more: str, port: int | None = None) -> Iterator[Running]:
        self._starts += 1
        self.settings.write_text(
            SETTINGS.format(
                orbiter=self.sky.orbiter_port,
                rover=self.sky.rover_ports["jackal"],
                port=port or self.port,
            )
        )
        log = self.sky.folder / f"orbiter-{self._starts}.log"
        options = ("--config", str(self.settings), "--data", str(self.sky.folder / "data"))
        with running(log, "rover-mops", *options, *more) as process:
            process.output(r"jackal listens at (maltcp://\S+)")
            yield process

    async def client(self, port: int | None = None) -> MrsClient:
        return await MrsClient.connect(f"127.0.0.1:{port or self.port}", patience_s=LIMIT_S)


@pytest.fixture
def orbiter(tmp_path: Path) -> Orbiter:
    return Orbiter(tmp_path)


async def test_an_acknowledged_command_is_uplinked_after_a_kill(orbiter: Orbiter) -> None:
    with orbiter.serving() as first:
        async with await orbiter.client() as client:
            commands = [client.command(MoveForward(float(n))) for n in range(1, 6)]
            for command in commands:
                await client.submit(command)
            first.end(signal.SIGKILL)
    with orbiter.serving():
        async with landed(orbiter.sky, "jackal") as rover, await orbiter.client() as client:
            past = await catch_up(client, len(commands) * len(STAGES))
            assert [m.inputs for m in rover.commands] == [(f"{float(n)}",) for n in range(1, 6)]
            assert rover.received == len(commands)
            assert [n.sequence for n in past] == list(range(1, len(past) + 1))


def test_an_unavailable_resource_is_reported_in_one_line(orbiter: Orbiter) -> None:
    with orbiter.serving():
        taken = ("--config", str(orbiter.settings), "--data", str(orbiter.sky.folder / "other"))
        with running(orbiter.sky.folder / "second.log", "rover-mops", *taken) as second:
            assert second.ended() == 1
            where = f"127.0.0.1:{orbiter.sky.orbiter_port}"
            assert f"Error: cannot listen for bundles at {where}: Address already in" in second.text
            assert "Traceback" not in second.text
        text = orbiter.settings.read_text().replace(f"port: {orbiter.sky.orbiter_port}", "port: 0")
        orbiter.settings.write_text(text)
        with running(orbiter.sky.folder / "next.log", "rover-mops", *taken) as second:
            assert second.ended() == 1
            where = f"jackal at 127.0.0.1:{orbiter.port}"
            assert f"Error: cannot serve {where}: Address already in use; choose" in second.text
    plan = orbiter.sky.folder / "contacts.ionrc"
    plan.write_text("a contact +0 +1 1 2\n")
    with orbiter.settings.open("a") as settings:
        settings.write("contact_plan: contacts.ionrc\n")
    with running(orbiter.sky.folder / "third.log", "rover-mops", *taken) as third:
        assert third.ended() == 1
        assert "contacts.ionrc: line 1" in third.text


def test_one_relay_works_in_a_folder_and_it_ends_by_a_signal(orbiter: Orbiter) -> None:
    with orbiter.serving() as first:
        data = str(orbiter.sky.folder / "data")
        with running(orbiter.sky.folder / "second.log", "rover-mops", "--data", data) as second:
            assert second.ended() == 1
            assert "another process (" in second.text
        file = ("--data", str(orbiter.settings))
        with running(orbiter.sky.folder / "third.log", "rover-mops", *file) as third:
            assert third.ended() == 1
            assert "cannot be used: File exists; --data names another folder" in third.text
        assert first.end() == 0


def test_settings_that_make_no_sense_are_a_usage_error(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(SETTINGS.format(orbiter=1, rover=2, port=0).replace("ipn:2.1", "ipn:1.1"))
    with running(tmp_path / "log", "rover-mops", "--config", str(wrong)) as process:
        assert process.ended() == 2
        assert "are on one node, ipn:1.0: each needs a node of its own" in process.text


@pytest.mark.parametrize(
    ("more", "fault"),
    [
        ("lifetime_s: -1", "lifetime_s must be above 0"),
        ("retained_reports: 0", "retained_reports must be above 0"),
        ("retransmit_after_s: 0", "retransmit_after_s must be above 0"),
        ("retransmit_after_s: often", "retransmit_after_s"),
        ("agent: ionn", "'ionn' is none of embedded, ion"),
        ("prt: 1", "unknown key 'prt'; known are eid, listen, contact_plan"),
    ],
)
def test_figures_that_make_no_sense_are_refused(tmp_path: Path, more: str, fault: str) -> None:
    path = tmp_path / "orbiter.yaml"
    path.write_text(SETTINGS.format(orbiter=1, rover=2, port=0) + more)
    with pytest.raises(SettingsError, match=fault):
        load_orbiter(path)
    path.write_text(SETTINGS.format(orbiter=1, rover=2, port=70000))
    with pytest.raises(SettingsError, match="70000 is not in 0 to 65535"):
        load_orbiter(path)
    path.write_text(SETTINGS.format(orbiter=1, rover=2, port=0) + "retransmit_after_s: null")
    assert load_orbiter(path).retransmit_after_s is None


@pytest.mark.parametrize(
    ("operations", "fault"),
    [
        ("MotionControl.fly", "operations: MotionControl.fly carries no command; known are: "),
        ("MotionControl.drive", "operations: MotionControl.stop is missing"),
    ],
)
def test_an_unencodable_list_is_refused(tmp_path: Path, operations: str, fault: str) -> None:
    path = tmp_path / "orbiter.yaml"
    text = SETTINGS.format(orbiter=1, rover=2, port=0)
    path.write_text(f"{text.rstrip()}\n    operations: [{operations}]\n")
    with pytest.raises(SettingsError, match=fault):
        load_orbiter(path)


SECOND = """
  - asset: {asset}
    description: Scout
    domain: [meteron, scout]
    eid: ipn:{node}.1
    ltp: {{address: {{host: 127.0.0.1, port: {port}}}}}
    port: {mrs}
"""


@pytest.mark.parametrize(
    ("second", "what"),
    [
        ({"asset": "jackal"}, "the same asset, jackal"),
        ({"node": 2}, "the same node, ipn:2.0"),
        ({"mrs": 21100}, "the same port, 21100"),
        ({"port": 1114}, "the same ltp address, 127.0.0.1:1114"),
    ],
)
def test_rovers_that_share_what_each_needs_are_named(
    tmp_path: Path, second: dict[str, object], what: str
) -> None:
    path = tmp_path / "orbiter.yaml"
    first = SETTINGS.format(orbiter=1113, rover=1114, port=21100)
    other = {"asset": "scout", "node": 4, "port": 1116, "mrs": 21102}
    path.write_text(first + SECOND.format(**other))
    assert len(load_orbiter(path).rovers) == 2
    path.write_text(first + SECOND.format(**(other | second)))
    with pytest.raises(SettingsError, match=rf"rovers 1 \(jackal\) and 2 \(\w+\) have {what}"):
        load_orbiter(path)


async def test_a_client_receives_the_reports_of_its_absence(orbiter: Orbiter) -> None:
    with orbiter.serving():
        client = await orbiter.client()
        running = asyncio.create_task(client.run(client.command(MoveForward(1.0))))
        await received(client, "DTN_QUEUED", 1.0)
    foreign = free_port(socket.SOCK_STREAM)
    async with landed(orbiter.sky, "jackal"):
        with orbiter.serving(port=foreign):
            async with await orbiter.client(foreign) as other:
                await catch_up(other, len(STAGES))
        with orbiter.serving():
            assert (await asyncio.wait_for(running, LIMIT_S)).executed
        await client.close()


async def received(client: MrsClient, name: str, figure: float) -> None:
    async with asyncio.timeout(LIMIT_S):
        while True:
            (value,) = await client.get_value(name)
            if value.value == figure:
                return
            await asyncio.sleep(0.02)
