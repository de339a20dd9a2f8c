"""The processes of a storm, and what happens to them.

orbiter ══ LTP ══ proxy ══ LTP ══ rover-relay ── ROS topics ── rover
(killed)                           (killed)                    (not killed)
"""

import re
import shutil
import socket
import sqlite3
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from sim.processes.place import ANY_PORT, HOST, Place
from sim.relay_storm import orbiter, proxy, rover
from sim.relay_storm.clocked import set_clock
from sim.relay_storm.disk import Disk, NoDiskError, small_disk
from sim.relay_storm.part import Part
from sim.relay_storm.traffic import ASSET, NAME, read_lines

SCALE: Final = 20.0
"""By what the times of the link are divided."""
ANSWER_S: Final = 0.1
"""What an LTP engine is given to answer: divided likewise."""
STEPS_S: Final = (-3600.0, -7200.0)
"""How far clocks are stepped back."""
FULL_S: Final = 1.0
STALL_S: Final = 90.0
"""Without anything at the topic, after which nothing is awaited any more."""
QUIET_S: Final = 2.0
"""Without anything at the topic, after which nothing is on its way."""
LOOK_S: Final = 0.1
HASTE_S: Final = 0.3
"""Between the progress that calls for a kill and the kill, at most."""
ORBITER_RECORD: Final = "orbiter.sqlite"
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Plan:
    """What a storm is to be.

    Attributes:
        messages: commands to be acknowledged, each of which has one report.
        kills: of the two sides in turn, in random order.
        loss: part of the datagrams that is lost.
        seed: of when what happens.
    """

    messages: int
    kills: int
    loss: float
    seed: int


@unique
class Mishap(Enum):
    """What happens."""

    KILL_ORBITER = "orbiter killed"
    KILL_RELAY = "rover-relay killed"
    STEP_ORBITER = "orbiter's clock stepped back"
    STEP_RELAY = "rover-relay's clock stepped back"
    FILL_ORBITER = "orbiter's disk full"
    FILL_RELAY = "rover-relay's disk full"


KILLS: Final = (Mishap.KILL_RELAY, Mishap.KILL_ORBITER)
OTHERS: Final = (
    Mishap.FILL_RELAY,
    Mishap.STEP_ORBITER,
    Mishap.FILL_ORBITER,
    Mishap.STEP_RELAY,
    Mishap.FILL_RELAY,
    Mishap.FILL_ORBITER,
)


@dataclass(frozen=True, slots=True)
class Remains:
    """What is left.

    Attributes:
        folder: journals and the rover's ledger.
        record: the orbiter's.
        duration_s: from the first command to the last report.
        relay_killed_s: when rover-relay was killed, in monotonic time.
        happened: what happened, in turn.
        link: what the proxy says it has done.
        no_disk: why no disk could be filled; nothing if they were.
    """

    folder: Path
    record: Path
    duration_s: float
    relay_killed_s: tuple[float, ...]
    happened: tuple[Mishap, ...]
    link: dict[str, int]
    no_disk: str


def storm(place: Place, folder: Path, plan: Plan, tell: Tell) -> Remains:
    """Let it storm, wait until all has settled, and return what is left.

    Args:
        place: a ROS domain that nobody else uses.
        folder: empty; journals, records and logs go there.
        plan: what is to happen.
        tell: called with a line on each thing that happens.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: a process did not start.
    """
    with ExitStack() as stack:
        disks, no_disk = _disks(stack, folder)
        parts = stack.enter_context(_parts(place, folder, disks, plan))
        began_s, killed_s = time.monotonic(), list[float]()
        progress = _Progress(folder / rover.TOPIC)
        random, happened = Random(plan.seed), list[Mishap]()
        for at, mishap in _mishaps(plan, random, bool(no_disk)):
            if not progress.reaches(at, parts.check):
                tell(f"nothing comes any more after {progress.count} messages")
                break
            time.sleep(random.uniform(0.0, HASTE_S))
            tell(f"{time.monotonic() - began_s:6.1f} s {progress.count:6d}  {mishap.value}")
            happened.append(mishap)
            if mishap is Mishap.KILL_RELAY:
                killed_s.append(time.monotonic())
            parts.befall(mishap)
        _settle(parts, folder, disks.orbiter, plan.messages, progress)
        duration_s = time.monotonic() - began_s
        link = parts.end()
        record = folder / ORBITER_RECORD
        for path in disks.orbiter.folder.glob(f"{ASSET}.sqlite*"):
            shutil.copy(path, folder / path.name.replace(ASSET, "orbiter"))
        return Remains(folder, record, duration_s, tuple(killed_s), tuple(happened), link, no_disk)


@dataclass(frozen=True, slots=True)
class _Disks:
    orbiter: Disk
    relay: Disk


@dataclass(frozen=True, slots=True)
class _Parts:
    orbiter: Part
    relay: Part
    proxy: Part
    rover: Part
    disks: _Disks
    clocks: tuple[Path, Path]

    def check(self) -> None:
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
            case Mishap.FILL_ORBITER:
                self._fill(self.orbiter, self.disks.orbiter)
            case Mishap.FILL_RELAY:
                self._fill(self.relay, self.disks.relay)

    def _fill(self, part: Part, disk: Disk) -> None:
        part.wait()
        disk.fill()
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


class _Progress:
    """Counts the lines of the topic's journal."""

    def __init__(self, path: Path) -> None:
        self._path, self._read = path, 0
        self.count = 0

    def look(self) -> int:
        with self._path.open("rb") as journal:
            journal.seek(self._read)
            octets = journal.read()
        self._read += len(octets)
        self.count += octets.count(b"\n")
        return self.count

    def reaches(self, count: int, check: Callable[[], None]) -> bool:
        """Wait for so many; return False where nothing comes any more."""
        last, last_s = self.look(), time.monotonic()
        while self.count < count:
            check()
            time.sleep(LOOK_S)
            if self.look() > last:
                last, last_s = self.count, time.monotonic()
            elif time.monotonic() - last_s > STALL_S:
                return False
        return True


def _mishaps(plan: Plan, random: Random, undisturbed: bool) -> list[tuple[int, Mishap]]:
    """Return what is to happen after how many messages, in turn."""
    kills = [KILLS[number % len(KILLS)] for number in range(plan.kills)]
    random.shuffle(kills)
    others = [each for each in OTHERS if not (undisturbed and "FILL" in each.name)]
    after = [plan.messages * (number + 1) // (len(others) + 1) for number in range(len(others))]
    found = [(random.randrange(plan.messages), kill) for kill in kills]
    return sorted([*found, *zip(after, others, strict=True)], key=lambda each: each[0])


def _disks(stack: ExitStack, folder: Path) -> tuple[_Disks, str]:
    """Return the disks of both sides, and why they cannot be filled, if so."""
    one, two = folder / "orbiter", folder / "relay"
    try:
        disks = [stack.enter_context(small_disk(each)) for each in (one, two)]
    except NoDiskError as error:
        return _Disks(Disk(one), Disk(two)), str(error)
    return _Disks(*disks), ""


@contextmanager
def _parts(place: Place, folder: Path, disks: _Disks, plan: Plan) -> Iterator[_Parts]:
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
        found = _Parts(
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


def _settle(parts: _Parts, folder: Path, disk: Disk, messages: int, progress: _Progress) -> None:
    """Wait until everything is where it belongs, unless nothing moves any more."""
    last_s = time.monotonic()
    while (quiet_s := time.monotonic() - last_s) < STALL_S:
        parts.check()
        before = progress.count
        if progress.look() > before:
            last_s = time.monotonic()
        acknowledged = len(read_lines(folder / orbiter.ACKNOWLEDGED))
        done, known = _reports(folder / rover.LEDGER), _reports(disk.folder / f"{ASSET}.sqlite")
        if messages <= acknowledged <= done <= known and quiet_s > QUIET_S:
            return
        time.sleep(QUIET_S / 2)


def _reports(path: Path) -> int:
    db = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        ((count,),) = db.execute("SELECT count(*) FROM reports").fetchall()
    finally:
        db.close()
    return int(count)


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
