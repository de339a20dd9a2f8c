"""The processes of a storm, how they find each other, and what can be done to them.

orbiter ══ LTP ══ proxy ══ LTP ══ rover-relay ── ROS topics ── rover
(killed)                           (killed)                    (not killed)
"""

import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from sim.processes.place import ANY_PORT, HOST, Place
from sim.relay_storm import orbiter, proxy, rover
from sim.relay_storm.clocked import set_clock
from sim.relay_storm.disk import Disk, NoDiskError, small_disk
from sim.relay_storm.mishaps import Mishap, Plan
from sim.relay_storm.part import Part
from sim.relay_storm.traffic import ASSET, NAME

SCALE: Final = 20.0
"""By what the times of the link are divided."""
ANSWER_S: Final = 0.1
"""What an LTP engine is given to answer: divided likewise."""
STEPS_S: Final = (-3600.0, -7200.0)
"""How far clocks are stepped back."""
FULL_S: Final = 0.5


@dataclass(frozen=True, slots=True)
class Disks:
    """Where both sides keep what they have."""

    orbiter: Disk
    relay: Disk


@dataclass(frozen=True, slots=True)
class Site:
    """All that runs."""

    orbiter: Part
    relay: Part
    proxy: Part
    rover: Part
    disks: Disks
    clocks: tuple[Path, Path]

    def check(self) -> None:
        """Raise ChildError if a process ended by itself."""
        for part in (self.rover, self.proxy, self.relay, self.orbiter):
            part.child.check()

    def befall(self, mishap: Mishap) -> None:
        """Let something happen."""
        match mishap:
            case Mishap.KILL_ORBITER:
                self.orbiter.kill()
            case Mishap.KILL_RELAY:
                self.relay.kill()
            case Mishap.STEP_ORBITER:
                set_clock(self.clocks[0], STEPS_S[0])
            case Mishap.STEP_RELAY:
                set_clock(self.clocks[1], STEPS_S[1])
            case Mishap.FILL_ORBITER | Mishap.DIE_ORBITER:
                self._fill(self.orbiter, self.disks.orbiter, mishap is Mishap.DIE_ORBITER)
            case Mishap.FILL_RELAY | Mishap.DIE_RELAY:
                self._fill(self.relay, self.disks.relay, mishap is Mishap.DIE_RELAY)

    def _fill(self, part: Part, disk: Disk, deadly: bool) -> None:
        part.wait()
        disk.fill()
        time.sleep(FULL_S)
        if deadly:
            part.kill()
            part.wait()
            time.sleep(FULL_S)
        disk.empty()

    def end(self) -> dict[str, int]:
        """End all; return what the proxy has done."""
        self.orbiter.child.kill()
        self.relay.child.end()
        self.proxy.child.end()
        said = self.proxy.child.said(re.compile(f"{proxy.DONE}(.*)"))
        pairs = (word.split("=") for word in said[1].split()) if said else ()
        return {kind: int(number) for kind, number in pairs}


def disks(stack: ExitStack, folder: Path) -> tuple[Disks, str]:
    """Return the disks of both sides, and why they cannot be filled, if so."""
    one, two = folder / "orbiter", folder / "relay"
    try:
        disks = [stack.enter_context(small_disk(each)) for each in (one, two)]
    except NoDiskError as error:
        return Disks(Disk(one), Disk(two)), str(error)
    return Disks(*disks), ""


@contextmanager
def site(place: Place, folder: Path, disks: Disks, plan: Plan) -> Iterator[Site]:
    """Yield all processes, each of them up; in the end they are killed."""
    orbiter_port, relay_port, from_orbiter, from_relay = _free_ports(4)
    settings, relay_settings = folder / "orbiter.yaml", folder / "relay.yaml"
    settings.write_text(_orbiter_yaml(orbiter_port, from_orbiter), encoding="utf-8")
    relay_settings.write_text(_relay_yaml(relay_port, from_relay), encoding="utf-8")
    clocks = (folder / "orbiter.clock", folder / "relay.clock")
    for clock in clocks:
        set_clock(clock, 0.0)
    running: list[Part] = []

    def part(name: str, up: str, line: Callable[[int], Sequence[str]]) -> Part:
        running.append(Part(name, folder, {"ROS_DOMAIN_ID": str(place.domain)}, line, up))
        return running[-1]

    def clocked(clock: Path, *line: object) -> Sequence[str]:
        return ("sim.relay_storm.clocked", str(clock), *map(str, line))

    def proxy_line(_: int) -> Sequence[str]:
        ends = ((from_orbiter, relay_port), (from_relay, orbiter_port))
        told = [str(each) for end in ends for each in ("--end", *end)]
        weather = ("--loss", plan.loss, "--scale", SCALE, "--seed", plan.seed)
        return ("sim.relay_storm.proxy", *told, *map(str, weather))

    def relay_line(_: int) -> Sequence[str]:
        return clocked(
            clocks[1], "adapters.relay.process", "--asset", ASSET,
            "--config", relay_settings, "--data", disks.relay.folder,
        )  # fmt: skip

    def orbiter_line(life: int) -> Sequence[str]:
        return clocked(
            clocks[0], "sim.relay_storm.orbiter", "--config", settings,
            "--data", disks.orbiter.folder, "--folder", folder,
            "--life", life, "--messages", plan.messages,
        )  # fmt: skip

    try:
        found = Site(
            proxy=part("proxy", proxy.LISTENS, proxy_line),
            rover=part("rover", rover.LISTENS, lambda _: ("sim.relay_storm.rover", str(folder))),
            relay=part("relay", f"relays for {NAME}", relay_line),
            orbiter=part("orbiter", orbiter.LISTENS, orbiter_line),
            disks=disks,
            clocks=clocks,
        )
        for each in running:
            each.wait()
        yield found
    finally:
        for each in reversed(running):
            each.child.kill()


def _orbiter_yaml(listen: int, proxied: int) -> str:
    return f"""\
eid: ipn:1.1
listen: {{ltp: {{host: {HOST}, port: {listen}}}}}
rovers:
  - asset: {ASSET}
    description: a rover in a storm
    domain: [meteron, {ASSET}]
    eid: ipn:2.1
    ltp: {{address: {{host: {HOST}, port: {proxied}}}, answer_s: {ANSWER_S}}}
    port: 0
"""


def _relay_yaml(listen: int, proxied: int) -> str:
    return f"""\
asset: {NAME}
eid: ipn:2.1
orbiter: {{eid: ipn:1.1, ltp: {{address: {{host: {HOST}, port: {proxied}}}, answer_s: {ANSWER_S}}}}}
listen: {{ltp: {{host: {HOST}, port: {listen}}}}}
"""


def _free_ports(count: int) -> list[int]:
    with ExitStack() as held:
        probes = [
            held.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            for _ in range(count)
        ]
        for probe in probes:
            probe.bind((HOST, ANY_PORT))
        return [int(probe.getsockname()[1]) for probe in probes]
