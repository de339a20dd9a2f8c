"""Two executives as processes, each in a ROS domain of its own: one reads the other, by kill -9."""

import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec.types import AssetMode, NotificationKind, Severity
from executive.commands.catalogue import SetTravelSpeed
from executive.values.reports import Report
from tests.conftest import port_of, reserved_domain
from tests.suite import CHECKOUT
from tests.support.ground import T, call_ground
from tests.support.processes import LIMIT_S, LISTENS, Running, running

pytestmark = pytest.mark.ros

WARNED = [Severity.WARNING]


class Rovers:
    """Executives without a rover below, each with its files; started and started again."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch, held: ExitStack) -> None:
        self._folder = folder
        self._patch = patch
        self._held = held
        names = ("jackal", "scout")
        self._domains = {name: held.enter_context(reserved_domain()) for name in names}
        self.uris = {
            name: f"maltcp://127.0.0.1:{port_of(domain)}/MRS"
            for name, domain in self._domains.items()
        }
        for kind in ("yaml", "ros.yaml"):
            text = (CHECKOUT / "config" / f"jackal.{kind}").read_text()
            (folder / f"jackal.{kind}").write_text(text)
            (folder / f"scout.{kind}").write_text(text.replace("jackal", "scout"))
        patch.setenv("ROVER_CONFIG", str(folder))

    def start(self, name: str, *arguments: str) -> Running:
        self._patch.setenv("ROS_DOMAIN_ID", str(self._domains[name]))
        port = self.uris[name].rpartition(":")[2].partition("/")[0]
        log = self._folder / f"{name}-{time.monotonic_ns()}.log"
        options = ("--asset", name, "--port", port, "--data", str(self._folder / name))
        process = self._held.enter_context(running(log, "rover-executive", *options, *arguments))
        process.output(LISTENS)
        return process

    def request(self, name: str, session: Callable[[MrsClient], Awaitable[T]]) -> T:
        return call_ground(self.uris[name], session)

    def modes(self, name: str) -> dict[str, AssetMode]:
        assets = self.request(name, lambda client: client.list_assets())
        return {asset.asset: asset.mode for asset in assets}

    def answering(self, name: str) -> set[str]:
        modes = self.modes(name)
        return {asset for asset, mode in modes.items() if mode is not AssetMode.OFFLINE}

    def received(self, name: str, of: str) -> list[Report]:
        found = self.request(name, lambda client: client.get_asset_notifications(of))
        return [each.report for each in found]


@pytest.fixture
def rovers(ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Rovers]:
    assert ros_domain
    with ExitStack() as held:
        yield Rovers(tmp_path, monkeypatch, held)


def eventually(holds: Callable[[], bool]) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not holds():
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def test_each_reads_the_other_over_kills_and_restarts(rovers: Rovers) -> None:
    both = {"jackal", "scout"}
    jackal = rovers.start("jackal")
    scout = rovers.start("scout", "--service-layer", rovers.uris["jackal"])
    for name in both:
        eventually(lambda: rovers.answering(name) == both)  # noqa: B023

    jackal.end(signal.SIGKILL)
    eventually(lambda: rovers.modes("scout")["jackal"] is AssetMode.OFFLINE)
    eventually(lambda: [n.severity for n in rovers.received("scout", "scout")][-1:] == WARNED)
    assert rovers.received("scout", "scout")[-1].kind is NotificationKind.LINK
    speed = rovers.request("scout", lambda client: client.run(client.command(SetTravelSpeed(0.25))))
    assert speed.executed

    rovers.start("jackal")
    eventually(lambda: rovers.modes("jackal").keys() == both)
    eventually(lambda: rovers.received("jackal", "scout") == rovers.received("scout", "scout"))

    scout.end(signal.SIGKILL)
    eventually(lambda: rovers.modes("jackal")["scout"] is AssetMode.OFFLINE)
    scout = rovers.start("scout", "--service-layer", rovers.uris["jackal"])
    eventually(lambda: rovers.modes("jackal")["scout"] is not AssetMode.OFFLINE)
    eventually(lambda: rovers.received("jackal", "scout") == rovers.received("scout", "scout"))

    assert scout.end() == 0
    services = rovers.request("jackal", lambda client: client.get_services())
    assert "scout.ServiceLayer" not in {service.name for service in services}
