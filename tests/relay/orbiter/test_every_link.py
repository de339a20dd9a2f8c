"""`rover-mops` and the rover's end joined by each link; the orbiter's end is killed in between."""

import asyncio
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from adapters.bundle import Address, Listen, LtpLink, Peer
from adapters.bundle.node.settings import TcpclLink, UdpLink
from adapters.mops import Message, decode, load_dictionary, reply_of
from adapters.mrs.ground import MrsClient
from adapters.relay.rover import RelaySettings
from adapters.relay.rover.bridge import BundleBridge
from executive.commands.catalogue import MoveForward
from executive.values.reports import Identity, Report, ReportKind, Severity
from tests.relay.orbiter.sky import HERE, LIMIT_S, STAGES, catch_up, until
from tests.relay.rover.ends import Rover, bridge_of
from tests.support.ports import free_port
from tests.support.processes import Running, running

DICTIONARY = load_dictionary()
SETTINGS = """
eid: ipn:1.1
listen: {{{protocol}: {{host: 127.0.0.1, port: {own}}}}}
rovers:
  - asset: jackal
    description: Jackal
    domain: [meteron, jackal]
    eid: ipn:2.1
    {protocol}: {link}
    port: {port}
"""


@dataclass(frozen=True)
class Route:
    """How the two ends are joined: the orbiter's YAML, and the rover's settings."""

    protocol: str
    yaml: str
    link: Callable[[Address], LtpLink | TcpclLink | UdpLink]
    kind: socket.SocketKind = socket.SOCK_DGRAM


TO_ROVER = "{address: {host: 127.0.0.1, port: ROVER}, MORE}"
ROUTES = {
    "ltp": Route(
        "ltp", TO_ROVER.replace("MORE", "answer_s: 0.2"), lambda to: LtpLink(to, answer_s=0.2)
    ),
    "udp": Route(
        "udp",
        TO_ROVER.replace("MORE", "confirm_after_s: 0.2"),
        lambda to: UdpLink(to, confirm_after_s=0.2),
    ),
    "tcpcl": Route(
        "tcpcl", "{address: null}", lambda to: TcpclLink(to, redial_s=0.1), socket.SOCK_STREAM
    ),
    "tcpcl without acknowledgements": Route(
        "tcpcl",
        "{address: null, acknowledge: false, confirm_after_s: 0.2}",
        lambda to: TcpclLink(to, acknowledge=False, redial_s=0.1, confirm_after_s=0.2),
        socket.SOCK_STREAM,
    ),
}


class Ends:
    """Both ends; the rover says nothing of a command before it is told to."""

    def __init__(self, folder: Path, path: Route) -> None:
        self.folder, self.route = folder, path
        self.own, self.rover = free_port(path.kind), free_port(path.kind)
        self.port = free_port(socket.SOCK_STREAM)
        self.topics = Rover()
        self._starts = self._output = 0

    @contextmanager
    def orbiter(self) -> Iterator[Running]:
        self._starts += 1
        config = self.folder / "orbiter.yaml"
        link = self.route.yaml.replace("ROVER", str(self.rover))
        config.write_text(
            SETTINGS.format(protocol=self.route.protocol, own=self.own, link=link, port=self.port)
        )
        options = ("--config", str(config), "--data", str(self.folder / "orbiter"))
        log = self.folder / f"orbiter-{self._starts}.log"
        with running(log, "rover-mops", *options) as process:
            process.output(r"jackal listens at (maltcp://\S+)")
            yield process

    @contextmanager
    def landed(self) -> Iterator[BundleBridge]:
        protocol, to = self.route.protocol, self.route.link(Address(HERE, self.own))
        settings = RelaySettings(
            asset="JACKAL",
            eid="ipn:2.1",
            orbiter=Peer(eid="ipn:1.1", **{protocol: to}),  # type: ignore[arg-type]
            listen=Listen(**{protocol: Address(HERE, self.rover)}),
        )
        link = bridge_of(settings, self.folder / "rover.db", self.topics)
        link.start()
        try:
            yield link
        finally:
            link.close()

    def client(self) -> "asyncio.Future[MrsClient]":
        return asyncio.ensure_future(MrsClient.connect(f"{HERE}:{self.port}", patience_s=LIMIT_S))

    @property
    def commands(self) -> list[Message]:
        return [decode(text.encode()) for text in self.topics.commands]

    def stages_of(self, command: Message) -> str:
        message = []
        identity = Identity(command.source, command.moe_inputs_id or 0)
        for stage in STAGES:
            self._output += 1
            report = Report(
                self._output, time.time(), ReportKind.COMMAND, Severity.INFORMATIONAL, stage.name,
                identity, stage, "relay",
            )  # fmt: skip
            entry = DICTIONARY.entry(command)
            message.append(str(reply_of(report, entry, "JACKAL", ledger="first")))
        return "".join(message)


@pytest.mark.parametrize("path", ROUTES.values(), ids=ROUTES.keys())
async def test_a_kill_of_the_orbiter_loses_no_report_on_any_link(
    tmp_path: Path, path: Route
) -> None:
    ends = Ends(tmp_path, path)

    with ends.landed() as link:
        with ends.orbiter() as first:
            async with await ends.client() as client:
                await client.submit(client.command(MoveForward(1.0)))
            await until(lambda: len(ends.commands) == 1)
            # What is said now is in its sockets when it is killed, and nowhere else.
            first.send(signal.SIGSTOP)
            link.notify(ends.stages_of(ends.commands[0]))
            await until(lambda: len(ends.topics.confirmed) == 1)
            first.end(signal.SIGKILL)
        with ends.orbiter():
            async with await ends.client() as client:
                past = await catch_up(client, len(STAGES))
                assert sorted(each.sequence for each in past) == [1, 2, 3, 4]
                running = asyncio.create_task(client.run(client.command(MoveForward(2.0))))
                await until(lambda: len(ends.commands) == 2)
                link.notify(ends.stages_of(ends.commands[1]))
                assert (await asyncio.wait_for(running, LIMIT_S)).executed
            await until(lambda: link.health is not None and link.health.queued <= 1)
