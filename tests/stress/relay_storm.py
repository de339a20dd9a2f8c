"""Messages both ways over a bad link between processes that are killed: is one lost, or doubled?

orbiter ══ LTP ══ proxy ══ LTP ══ rover-relay ── ROS topics ── rover
(killed)                           (killed)                    (not killed)"""

import re
import shutil
import socket
import sqlite3
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from sim.processes import ANY_PORT, HOST, Place, free_place
from tests.stress import lossy_link, relay_orbiter, relay_rover
from tests.stress.fake_clock import set_clock
from tests.stress.relay_judge import (
    Fault,
    Verdict,
    gather,
    judge,
)
from tests.stress.relay_traffic import ASSET, NAME, read_lines
from tests.stress.small_disk import Disk, NoDiskError, small_disk
from tests.stress.victims import Victim
from tests.support.figures import Figure, Goal


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
class InjectedFault(Enum):
    """What happens."""

    KILL_ORBITER = "orbiter killed"
    KILL_RELAY = "rover-relay killed"
    STEP_ORBITER = "orbiter's clock stepped back"
    STEP_RELAY = "rover-relay's clock stepped back"
    FILL_ORBITER = "orbiter's disk full"
    FILL_RELAY = "rover-relay's disk full"
    DIE_ORBITER = "orbiter killed while its disk is full"
    DIE_RELAY = "rover-relay killed while its disk is full"


KILLS: Final = (InjectedFault.KILL_RELAY, InjectedFault.KILL_ORBITER)
STEPS: Final = (InjectedFault.STEP_ORBITER, InjectedFault.STEP_RELAY)
FILLS: Final = (InjectedFault.FILL_RELAY, InjectedFault.FILL_ORBITER)
DEATHS: Final = (InjectedFault.DIE_ORBITER, InjectedFault.DIE_RELAY)
EARLY: Final = (60, 150)
"""Messages after which disks are first full: while stores still grow, so that writes fail."""


def fault_schedule(
    plan: Plan, random: Random, undisturbed: bool
) -> list[tuple[int, InjectedFault]]:
    """Return what is to happen after how many messages, in turn.

    Args:
        plan: how much.
        random: of the kills.
        undisturbed: whether no disk can be filled.
    """
    kills = [KILLS[number % len(KILLS)] for number in range(plan.kills)]
    random.shuffle(kills)
    found = [(random.randrange(plan.messages), kill) for kill in kills]
    third = plan.messages // 3
    found += zip((third, 2 * third), STEPS, strict=True)
    if not undisturbed:
        found += zip((min(each, third) for each in EARLY), FILLS, strict=True)
        found += zip((third, 2 * third), DEATHS, strict=True)
    return sorted(found, key=lambda each: each[0])


LOOK_S: Final = 0.1
STALL_S: Final = 90.0
"""Without anything at the topic, after which nothing is awaited any more."""
QUIET_S: Final = 2.0
"""Without anything at the topic, after which nothing is on its way."""


class Progress:
    """Counts what came to the topic.

    Attributes:
        count: strings, as of the last look.
    """

    def __init__(self, path: Path) -> None:
        """Count the lines of the topic's journal."""
        self._path, self._read = path, 0
        self.count = 0

    def look(self) -> int:
        """Count what came meanwhile; return the count."""
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


def settle(
    folder: Path, disk: Path, messages: int, progress: Progress, check: Callable[[], None]
) -> None:
    """Wait until everything is where it belongs, unless nothing moves any more.

    Args:
        folder: of the journals and the rover's ledger.
        disk: of the orbiter's record.
        messages: commands that are to be acknowledged, each of which has one report.
        progress: counts what comes to the topic.
        check: raises if a process ended.
    """
    last_s = time.monotonic()
    while (quiet_s := time.monotonic() - last_s) < STALL_S:
        check()
        before = progress.count
        if progress.look() > before:
            last_s = time.monotonic()
        acknowledged = len(read_lines(folder / relay_orbiter.ACKNOWLEDGED))
        done, known = _reports(folder / relay_rover.LEDGER), _reports(disk / f"{ASSET}.sqlite")
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

    orbiter: Victim
    relay: Victim
    proxy: Victim
    rover: Victim
    disks: Disks
    clocks: tuple[Path, Path]

    def check(self) -> None:
        """Raise ChildError if a process ended by itself."""
        for part in (self.rover, self.proxy, self.relay, self.orbiter):
            part.child.check()

    def befall(self, mishap: InjectedFault) -> None:
        """Let something happen."""
        match mishap:
            case InjectedFault.KILL_ORBITER:
                self.orbiter.kill()
            case InjectedFault.KILL_RELAY:
                self.relay.kill()
            case InjectedFault.STEP_ORBITER:
                set_clock(self.clocks[0], STEPS_S[0])
            case InjectedFault.STEP_RELAY:
                set_clock(self.clocks[1], STEPS_S[1])
            case InjectedFault.FILL_ORBITER | InjectedFault.DIE_ORBITER:
                self._fill(self.orbiter, self.disks.orbiter, mishap is InjectedFault.DIE_ORBITER)
            case InjectedFault.FILL_RELAY | InjectedFault.DIE_RELAY:
                self._fill(self.relay, self.disks.relay, mishap is InjectedFault.DIE_RELAY)

    def _fill(self, part: Victim, disk: Disk, deadly: bool) -> None:
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
        said = self.proxy.child.said(re.compile(f"{lossy_link.DONE}(.*)"))
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
    running: list[Victim] = []

    def part(name: str, up: str, line: Callable[[int], Sequence[str]]) -> Victim:
        running.append(Victim(name, folder, {"ROS_DOMAIN_ID": str(place.domain)}, line, up))
        return running[-1]

    def clocked(clock: Path, *line: object) -> Sequence[str]:
        return ("tests.stress.fake_clock", str(clock), *map(str, line))

    def proxy_line(_: int) -> Sequence[str]:
        ends = ((from_orbiter, relay_port), (from_relay, orbiter_port))
        told = [str(each) for end in ends for each in ("--end", *end)]
        weather = ("--loss", plan.loss, "--scale", SCALE, "--seed", plan.seed)
        return ("tests.stress.lossy_link", *told, *map(str, weather))

    def relay_line(_: int) -> Sequence[str]:
        return clocked(
            clocks[1], "adapters.relay.rover.process", "--asset", ASSET,
            "--config", relay_settings, "--data", disks.relay.folder,
        )  # fmt: skip

    def orbiter_line(life: int) -> Sequence[str]:
        return clocked(
            clocks[0], "tests.stress.relay_orbiter", "--config", settings,
            "--data", disks.orbiter.folder, "--folder", folder,
            "--life", life, "--messages", plan.messages,
        )  # fmt: skip

    try:
        found = Site(
            proxy=part("proxy", lossy_link.LISTENS, proxy_line),
            rover=part(
                "rover", relay_rover.LISTENS, lambda _: ("tests.stress.relay_rover", str(folder))
            ),
            relay=part("relay", f"relays for {NAME}", relay_line),
            orbiter=part("orbiter", relay_orbiter.LISTENS, orbiter_line),
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


HASTE_S: Final = 0.3
"""Between the progress that calls for a mishap and the mishap, at most."""
ORBITER_RECORD: Final = "orbiter.sqlite"
FULL: Final = "disk is full"
"""As SQLite says it."""
Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Artifacts:
    """What is left.

    Attributes:
        folder: journals and the rover's ledger.
        record: the orbiter's.
        duration_s: from the first command to the last report.
        happened: what happened, in turn.
        link: what the proxy says it has done.
        unwritten: how often processes logged that a disk took nothing.
        no_disk: why no disk could be filled; nothing if they were.
    """

    folder: Path
    record: Path
    duration_s: float
    happened: tuple[InjectedFault, ...]
    link: dict[str, int]
    unwritten: int
    no_disk: str


def storm(place: Place, folder: Path, plan: Plan, tell: Tell) -> Artifacts:
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
        both, no_disk = disks(stack, folder)
        running = stack.enter_context(site(place, folder, both, plan))
        began_s = time.monotonic()
        progress = Progress(folder / relay_rover.TOPIC)
        random, happened = Random(plan.seed), list[InjectedFault]()
        for at, mishap in fault_schedule(plan, random, bool(no_disk)):
            if not progress.reaches(at, running.check):
                tell(f"nothing comes any more after {progress.count} messages")
                break
            time.sleep(random.uniform(0.0, HASTE_S))
            tell(f"{time.monotonic() - began_s:6.1f} s {progress.count:6d}  {mishap.value}")
            happened.append(mishap)
            running.befall(mishap)
        settle(folder, both.orbiter.folder, plan.messages, progress, running.check)
        duration_s = time.monotonic() - began_s
        link = running.end()
        for path in both.orbiter.folder.glob(f"{ASSET}.sqlite*"):
            shutil.copy(path, folder / path.name.replace(ASSET, "orbiter"))
        return Artifacts(
            folder=folder,
            record=folder / ORBITER_RECORD,
            duration_s=duration_s,
            happened=tuple(happened),
            link=link,
            unwritten=sum(path.read_text().count(FULL) for path in folder.glob("*-*.log")),
            no_disk=no_disk,
        )


TOLD_FAULTS: Final = 10
_LINK: Final = {
    "carried": "datagrams carried",
    "lost": "datagrams lost",
    "doubled": "datagrams doubled",
    "late": "datagrams delayed",
    "dark": "datagrams sent while there was no contact",
    "nights": "times without contact",
}
"""What the proxy counts, for people."""


def measure(plan: Plan, tell: Tell, keep: Path | None = None) -> list[Figure]:
    """Return how often a promise was broken, and what the storm came upon.

    Must be called on the main thread, which no other thread may run beside yet.

    Args:
        plan: what is to happen.
        tell: called with a line on each mishap and on each of the first faults.
        keep: an empty folder where everything is left; None for one that is gone in the end.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: a process did not start.
    """
    with free_place() as place, tempfile.TemporaryDirectory(prefix="rover-relay-") as passing:
        folder = keep or Path(passing)
        remains = storm(place, folder, plan, tell)
        verdict = judge(gather(remains.folder, remains.record))
        for fault, about in verdict.faults[:TOLD_FAULTS]:
            tell(f"{fault.value}: {about}")
        if remains.no_disk:
            tell(f"no disk was filled, for none can be made here: {remains.no_disk}")
        return _figures(plan, remains, verdict)


def _figures(plan: Plan, remains: Artifacts, verdict: Verdict) -> list[Figure]:
    beside = f"{plan.messages} each way, {plan.loss:.0%} loss, seed {plan.seed}"
    happened, faults = Counter(remains.happened), Counter(fault for fault, _ in verdict.faults)
    rate = verdict.commands / remains.duration_s
    return [
        *(Figure(f"relay: {each.value}", happened[each], "times") for each in InjectedFault),
        *(Figure(f"relay: {_LINK[kind]}", n, "") for kind, n in remains.link.items()),
        Figure("relay: writes that a full disk refused", remains.unwritten, "lines", "of the logs"),
        Figure("relay: duration", remains.duration_s, "s", beside),
        Figure("relay: messages each way, all mishaps included", rate, "1/s", beside),
        Figure("relay: commands at the topic", verdict.commands, "", "", Goal(plan.messages, True)),
        Figure("relay: of these not acknowledged", verdict.unacknowledged, ""),
        Figure("relay: commands published again", verdict.published_again, "", "the ledger knows"),
        Figure("relay: bundles given again after a kill", verdict.given_again, "", "record knows"),
        Figure("relay: reports in two bundles", verdict.told_again, "", "known by their number"),
        Figure("relay: reports kept, the orbiter killed before telling", verdict.untold, ""),
        *(Figure(f"relay: {each.value}", faults[each], "", beside, Goal(0)) for each in Fault),
    ]
