"""Messages both ways over a bad link between processes that are killed: is one lost, or doubled?

orbiter ══ LTP ══ proxy ══ LTP ══ rover-relay ── ROS topics ── rover
(killed)                           (killed)                    (not killed)
"""

import re
import shutil
import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from sim.processes import HOST
from tests.stress import lossy_link, relay_orbiter, relay_rover
from tests.stress.fake_clock import set_clock
from tests.stress.findings import Findings, Log
from tests.stress.journal import read_journal
from tests.stress.relay_judge import Fault, gather, judge
from tests.stress.relay_traffic import (
    ACKNOWLEDGED,
    ASSET,
    NAME,
    ORBITER_JOURNAL,
    ROVER_LEDGER,
    TOPIC_JOURNAL,
)
from tests.stress.small_disk import Disk, NoDiskError, small_disk
from tests.support.figures import Figure, Goal
from tests.support.ports import free_udp_ports
from tests.support.victims import Victim, Workplace, workplace

SCALE: Final = 20.0
"""By what the times of the link are divided."""
ANSWER_S: Final = 0.1
"""What an LTP engine is given to answer: divided likewise."""
CLOCK_STEPS_S: Final = {"orbiter": -3600.0, "rover-relay": -7200.0}
FULL_S: Final = 0.5
FULL: Final = "disk is full"
"""As SQLite says it."""
HASTE_S: Final = 0.3
"""Between the progress that calls for a fault and the fault, at most."""
POLL_S: Final = 0.1
STALL_S: Final = 90.0
"""Without anything at the topic, after which nothing is awaited any more."""
QUIET_S: Final = 2.0
"""Without anything at the topic, after which nothing is on its way."""


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
class Happening(Enum):
    """What is done to one of the two sides."""

    KILL = "killed"
    STEP = "clock stepped back"
    FILL = "disk full"
    DIE = "killed while its disk is full"


SIDES: Final = ("orbiter", "rover-relay")
EARLY: Final = (150, 60)
"""Messages after which disks are first full: while stores still grow, so that writes fail."""
InjectedFault = tuple[str, Happening]
"""A side, and what happens to it."""


def fault_schedule(plan: Plan, random: Random, with_disks: bool) -> list[tuple[int, InjectedFault]]:
    """Return what is to happen after how many messages, in turn."""
    kills = [SIDES[number % len(SIDES)] for number in range(plan.kills)]
    random.shuffle(kills)
    found = [(random.randrange(plan.messages), (side, Happening.KILL)) for side in kills]
    third = plan.messages // 3
    for number, side in enumerate(SIDES):
        found.append(((1 + number) * third, (side, Happening.STEP)))
        if with_disks:
            found.append((min(EARLY[number], third), (side, Happening.FILL)))
            found.append(((1 + number) * third, (side, Happening.DIE)))
    return sorted(found, key=lambda each: each[0])


class Side:
    """The orbiter or rover-relay: a process, its disk and its clock."""

    def __init__(self, folder: Path, name: str, stack: ExitStack) -> None:
        self.name, self.no_disk = name, ""
        self.clock = folder / f"{name}.clock"
        set_clock(self.clock, 0.0)
        try:
            self.disk = stack.enter_context(small_disk(folder / name))
        except NoDiskError as error:
            self.disk, self.no_disk = Disk(folder / name), str(error)
        self.victim: Victim

    def start(self, workspace: Workplace, up: str, line: Callable[[int], Sequence[object]]) -> None:
        self.victim = workspace.start_again(
            self.name, lambda run: ("tests.stress.fake_clock", self.clock, *line(run)), up
        )

    def suffer(self, happening: Happening) -> None:
        match happening:
            case Happening.KILL:
                self.victim.restart()
            case Happening.STEP:
                set_clock(self.clock, CLOCK_STEPS_S[self.name])
            case Happening.FILL | Happening.DIE:
                self._fill(killed=happening is Happening.DIE)

    def _fill(self, killed: bool) -> None:
        """Let its disk be full for a while, over its death if so."""
        self.victim.wait()
        self.disk.fill()
        time.sleep(FULL_S)
        if killed:
            self.victim.restart()
            self.victim.wait()
            time.sleep(FULL_S)
        self.disk.empty()


class Storm:
    """All that runs, how far it has come, and what can be done to it."""

    def __init__(self, workspace: Workplace, plan: Plan, stack: ExitStack) -> None:
        self._workspace, self._plan = workspace, plan
        self._folder = folder = workspace.folder
        self.sides = {name: Side(folder, name, stack) for name in SIDES}
        self.orbiter, self.relay = self.sides.values()
        up, down, from_orbiter, from_relay = free_udp_ports(4)
        settings, relay_settings = folder / "orbiter.yaml", folder / "relay.yaml"
        settings.write_text(_orbiter_yaml(up, from_orbiter), encoding="utf-8")
        relay_settings.write_text(_relay_yaml(down, from_relay), encoding="utf-8")
        self._proxy = workspace.start(
            "proxy", "tests.stress.lossy_link",
            "--end", from_orbiter, down, "--end", from_relay, up,
            "--loss", plan.loss, "--scale", SCALE, "--seed", plan.seed, up=lossy_link.LISTENS,
        )  # fmt: skip
        workspace.start("rover", "tests.stress.relay_rover", folder, up=relay_rover.LISTENS)
        self.relay.start(workspace, f"relays for {NAME}", lambda _: (
            "adapters.relay.rover.process", "--asset", ASSET,
            "--config", relay_settings, "--data", self.relay.disk.folder,
        ))  # fmt: skip
        self.orbiter.start(workspace, relay_orbiter.LISTENS, lambda run: (
            "tests.stress.relay_orbiter", settings, self.orbiter.disk.folder, folder,
            run, plan.messages,
        ))  # fmt: skip
        for victim in workspace.victims:
            victim.wait()

    @property
    def count(self) -> int:
        """How many strings came to the topic."""
        return (self._folder / TOPIC_JOURNAL).read_bytes().count(b"\n")

    def reaches(self, count: int) -> bool:
        """Wait for so many strings; return False where nothing comes any more."""
        last, last_s = self.count, time.monotonic()
        while (now := self.count) < count:
            self._workspace.check()
            if now > last:
                last, last_s = now, time.monotonic()
            elif time.monotonic() - last_s > STALL_S:
                return False
            time.sleep(POLL_S)
        return True

    def settle(self) -> None:
        """Wait until everything is where it belongs, unless nothing moves any more."""
        last, last_s = self.count, time.monotonic()
        while (quiet_s := time.monotonic() - last_s) < STALL_S:
            self._workspace.check()
            if self.count > last:
                last, last_s = self.count, time.monotonic()
            rows = read_journal(self._folder / ORBITER_JOURNAL)
            acknowledged = sum(row[0] == ACKNOWLEDGED for row in rows)
            done = _count_reports(self._folder / ROVER_LEDGER)
            known = _count_reports(self.orbiter.disk.folder / f"{ASSET}.sqlite")
            if self._plan.messages <= acknowledged <= done <= known and quiet_s > QUIET_S:
                return
            time.sleep(QUIET_S / 2)

    def end(self) -> list[Figure]:
        """End all, keep the orbiter's record; return what the link has done."""
        self.orbiter.victim.child.kill()
        self.relay.victim.child.end()
        self._proxy.child.end()
        for path in self.orbiter.disk.folder.glob(f"{ASSET}.sqlite*"):
            shutil.copy(path, self._folder / path.name.replace(ASSET, "orbiter"))
        message = self._proxy.child.find_output(re.compile(f"{lossy_link.DONE}(.*)"))
        pairs = (word.split("=") for word in message[1].split()) if message else ()
        return [Figure(f"relay: {lossy_link.COUNTS[kind]}", int(n), "") for kind, n in pairs]


def measure(plan: Plan, log: Log, output: Path | None = None) -> list[Figure]:
    """Return how often a promise was broken, and what the storm came upon.

    Args:
        plan: what is to happen.
        log: called with a line on each fault that is injected, and on each of the first found.
        output: an empty folder where everything is left; None for one that is gone in the end.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: a process did not start.
    """
    with ExitStack() as stack:
        workspace = stack.enter_context(workplace(output))
        storm = Storm(workspace, plan, stack)
        no_disk = storm.orbiter.no_disk or storm.relay.no_disk
        if no_disk:
            log(f"no disk is filled, for none can be made here: {no_disk}")
        began_s, random, happened = time.monotonic(), Random(plan.seed), Counter[InjectedFault]()
        for at, (side, happening) in fault_schedule(plan, random, not no_disk):
            if not storm.reaches(at):
                log(f"nothing comes any more after {storm.count} messages")
                break
            time.sleep(random.uniform(0.0, HASTE_S))
            log(f"{time.monotonic() - began_s:6.1f} s {storm.count:6d}  {side} {happening.value}")
            happened[side, happening] += 1
            storm.sides[side].suffer(happening)
        storm.settle()
        duration_s = time.monotonic() - began_s
        link = storm.end()
        unwritten = sum(path.read_text().count(FULL) for path in workspace.folder.glob("*-*.log"))
        verdict = judge(gather(workspace.folder, workspace.folder / "orbiter.sqlite"))
    beside = f"{plan.messages} each way, {plan.loss:.0%} loss, seed {plan.seed}"
    rate = verdict.commands / duration_s
    return [
        *(
            Figure(f"relay: {side} {each.value}", happened[side, each], "times")
            for each in Happening
            for side in SIDES
        ),
        *link,
        Figure("relay: writes that a full disk refused", unwritten, "lines", "of the logs"),
        Figure("relay: duration", duration_s, "s", beside),
        Figure("relay: messages each way, all faults included", rate, "1/s", beside),
        Figure("relay: commands at the topic", verdict.commands, "", "", Goal(plan.messages, True)),
        *(Figure(f"relay: {what}", number, "") for what, number in verdict.allowed.items()),
        *Findings(log, verdict.faults).figures("relay", Fault, beside),
    ]


def _count_reports(path: Path) -> int:
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as db:
        ((count,),) = db.execute("SELECT count(*) FROM reports").fetchall()
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
