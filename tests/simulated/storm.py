"""Plays a storm: the whole infrastructure in simulated time, killed and judged again and again."""

import hashlib
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import chdir, closing, contextmanager, redirect_stdout
from dataclasses import dataclass, replace
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Final, assert_never

from executive.faults import Reaction
from executive.settings import AuthoritySettings, Settings, load_settings
from tests.simulated.authority import AuthorityJudge
from tests.simulated.authority_requests import LEASE_S, RIVAL, RIVAL_SOURCE, RequestAuthority, do
from tests.simulated.brick import SimBrick
from tests.simulated.console import BROWSER_HOST, HOST, Browser, PageJournal, start_console
from tests.simulated.console_judge import ConsoleJudge
from tests.simulated.deeds import (
    CutChannel,
    Deed,
    FailWrite,
    FillDisk,
    Kill,
    KillAtWrite,
    Link,
    LoseSamples,
    Order,
    Pause,
    Situation,
    StepClock,
    Storm,
    Terminate,
    Unplug,
)
from tests.simulated.disk import Fate
from tests.simulated.ground import SOURCE, Ground, Journal
from tests.simulated.judge import Finding, check_end, check_stores
from tests.simulated.mocup import MocupAddress, start_mocup_executive, start_nxt
from tests.simulated.mocup_judge import MocupJudge
from tests.simulated.network import Channel
from tests.simulated.process import Process
from tests.simulated.processes import (
    MRS_PORT,
    Address,
    RoverBelow,
    start_executive,
    start_orbiter,
    start_relay,
)
from tests.simulated.rovers import check_apart, second, seen
from tests.simulated.world import World, make_folder
from tests.support.kinematic import with_figures
from tests.support.patience import BY_ARRIVAL, UNTIMED

QUIET_S: Final = 1600.0
"""After the last deed: for orbiters that ask again, although a clock was set back by 900 s."""
_LAST_FAULT_S: Final = 61.0
"""How long the longest fault lasts."""
_STEP_S: Final = 10.0
_WATCH_S: Final = 1.0
_LATE_S, _STALE_S = 30.0, 10.0
GROUNDS: Final = {"direct": "10.0.1.1", "moe": "10.0.1.2", RIVAL: "10.0.1.3"}
GROUNDS_2: Final = {"direct2": "10.0.1.4", "moe2": "10.0.1.5"}


def patient_settings(asset: str) -> Settings:
    """Return the settings of an asset that ticks once a second while it rests."""
    settings = load_settings(asset)
    names = (*UNTIMED, *BY_ARRIVAL.get(asset, ()))
    faults = {
        name: replace(getattr(settings.faults, name), reaction=Reaction.IGNORE) for name in names
    }
    faults["odometry_stale"] = with_figures(settings.faults.odometry_stale, above=_STALE_S)
    return replace(
        settings,
        faults=replace(settings.faults, **faults),
        safety=replace(settings.safety, watchdog_s=_LATE_S),
    )


@dataclass(frozen=True, slots=True)
class Played:
    """What came of a storm.

    Attributes:
        findings: broken promises, the first of each kind.
        kills: how many processes were killed.
        orders: how many commands were sent, repeats included.
        events: how many there were.
        simulated_s: how long it took in simulated time.
        digest: of all events, of what the ground received, and of all stores.
    """

    findings: tuple[Finding, ...]
    kills: int
    orders: int
    events: int
    simulated_s: float
    digest: str


class _WritePlan:
    """Decides about the writes of a process, as the deeds of a storm want it."""

    def __init__(self, killed: Callable[[float], None]) -> None:
        self._killed = killed
        self._waiting: list[tuple[int, Fate, float]] = []
        self._count = 0

    def add(self, writes: int, then: Fate, down_s: float = 0.0) -> None:
        self._waiting.append((self._count + writes, then, down_s))

    def fate(self, process: Process, path: Path) -> Fate:
        self._count += 1
        for each in self._waiting:
            number, then, down_s = each
            if number <= self._count:
                self._waiting.remove(each)
                if then is not Fate.FAILED:
                    self._killed(down_s)
                return then
        return Fate.DONE

    def clear(self) -> None:
        self._waiting.clear()


class Player:
    """Plays one storm.

    Args:
        storm: to be played.
        trace: takes a line for each event; None for none.

    Attributes:
        addresses: of the rovers behind the orbiter.
        own: by the suffix of a rover's processes, what its own ground clients know.
    """

    def __init__(self, storm: Storm, trace: list[str] | None = None) -> None:
        self._storm = storm
        situation = storm.situation
        address = (MocupAddress if situation.mocup else Address)(
            retransmit_after_s=situation.retransmit_after_s,
            answer_s=0.5 + 2.0 * (situation.delay_s + situation.jitter_s),
            convergence=situation.convergence,
        )
        self.world = world = World(storm.seed, Path(), trace)
        self.findings: dict[str, Finding] = {}
        self.kills = self.orders = 0
        self.addresses = [address] if situation.rovers == 1 else [address, second(address)]
        self._below: list[RoverBelow] = []
        self._plans: dict[str, _WritePlan] = {}
        self._due: set[str] = set()
        settings = patient_settings(address.asset)
        self.brick: SimBrick | None = None
        ends = {"direct": (address.executive, SOURCE), "moe": (address.orbiter, SOURCE)}
        needed = situation.authority_needed
        if needed is not None:
            ends[RIVAL] = address.executive, RIVAL_SOURCE
            authority = AuthoritySettings(
                needed=needed, lease_s=LEASE_S, takeover_sources=(RIVAL_SOURCE,)
            )
            settings = replace(settings, authority=authority)
        self.grounds = {
            name: Ground(f"maltcp://{host}:{MRS_PORT}/MRS", Journal(), source)
            for name, (host, source) in ends.items()
        }
        journals = {name: ground.journal for name, ground in self.grounds.items()}
        sources = {name: source for name, (_, source) in ends.items()}
        self._authority = AuthorityJudge(world, bool(needed), journals, sources)
        self.own = {"": journals}
        self._add("orbiter", address.orbiter, partial(start_orbiter, self.addresses))
        if situation.mocup:
            self.brick = SimBrick(world)
            self._mocup = MocupJudge(world, address.asset, self.brick, journals, bool(needed))
            self._add_mocup(address, settings)
        else:
            self._add_rover(address, settings)
        for other in self.addresses[1:]:
            journals = {"direct": Journal(), "moe": Journal()}
            self.own[other.suffix] = journals
            for name, host, port in (
                ("direct", other.executive, MRS_PORT),
                ("moe", other.orbiter, other.port),
            ):
                uri = f"maltcp://{host}:{port}/MRS"
                self.grounds[f"{name}{other.suffix}"] = Ground(uri, journals[name])
            self._add_rover(other, replace(patient_settings(address.asset), asset=other.asset))
        self.page: Browser | None = None
        if situation.console:
            self.page = Browser(address.asset, PageJournal())
            self._console = ConsoleJudge(world, address.asset, self.page.journal)
            self._add("console", HOST, partial(start_console, address))
            self._add("browser", BROWSER_HOST, self.page.start)
        for name, ground in self.grounds.items():
            self._add(name, (GROUNDS | GROUNDS_2)[name], ground.start)

    def play(self, *, until_found: bool = False, quiet_s: float = QUIET_S) -> Played:
        """Play it to its end, or until a promise is broken.

        Args:
            until_found: whether a broken promise ends it.
            quiet_s: how long the ground may wait for ends after the last fault.
        """
        world = self.world
        for process in world.processes.values():
            process.begin()
        for deed in self._storm.deeds:
            world.at(deed.at_s, self._do, deed)
        world.after(_WATCH_S, self._watch)
        end_s = max((deed.at_s for deed in self._storm.deeds), default=0.0)
        faults_end_s = end_s + _LAST_FAULT_S
        while world.now_s < faults_end_s and not (until_found and self.findings):
            world.run(min(world.now_s + _STEP_S, faults_end_s))
        self._calm()
        over_s = 0.0 if until_found and self.findings else faults_end_s + quiet_s
        while world.now_s < over_s and not self._settled():
            world.run(world.now_s + _STEP_S)
        if not (until_found and self.findings):
            self._check_end()
        return Played(
            tuple(self.findings.values()),
            self.kills,
            self.orders,
            world.count,
            world.now_s,
            self._digest(),
        )

    def _add_mocup(self, address: Address, settings: Settings) -> None:
        assert self.brick is not None
        self._add("relay", address.relay, partial(start_relay, address))
        self._add("nxt", "10.0.0.4", partial(start_nxt, address, self.brick))
        start = partial(start_mocup_executive, address, settings)
        self._add("executive", address.executive, start)
        channel = _channel(self._storm.situation)
        self.world.network.set_channel(address.orbiter, address.relay, channel)

    def _add_rover(self, address: Address, settings: Settings) -> None:
        self._add(f"relay{address.suffix}", address.relay, partial(start_relay, address))
        self._below.append(below := RoverBelow())
        start = partial(start_executive, address, below, settings)
        self._add(f"executive{address.suffix}", address.executive, start)
        channel = _channel(self._storm.situation)
        self.world.network.set_channel(address.orbiter, address.relay, channel)

    def _add(self, name: str, host: str, start: Callable[[Process], None]) -> None:
        process = self.world.process(name, host, start)
        self._plans[name] = process.disk.plan = _WritePlan(partial(self._killed, process))

    def _do(self, deed: Deed) -> None:
        world = self.world
        match deed:
            case Order(_, link, number, request):
                self.orders += 1
                sender = self.page if link is Link.CONSOLE else self.grounds[link.value]
                assert sender is not None
                sender.send(request, number)
            case Kill(_, name, down_s, power):
                process = world.processes[name]
                if process.alive:
                    if power:
                        process.cut_power()
                    else:
                        process.kill()
                    self._killed(process, down_s)
            case KillAtWrite(_, name, writes, after, down_s):
                fate = Fate.KILLED_AFTER if after else Fate.KILLED_BEFORE
                self._plans[name].add(writes, fate, down_s)
            case Terminate(_, name):
                world.processes[name].terminate()
            case FailWrite(_, name, writes):
                self._plans[name].add(writes, Fate.FAILED)
            case FillDisk(_, name, for_s):
                disk = world.processes[name].disk
                disk.full = True
                world.after(for_s, setattr, disk, "full", False)
            case Pause(_, name, for_s):
                world.processes[name].pause()
                world.after(for_s, world.processes[name].resume)
            case StepClock(_, name, step_s):
                world.processes[name].step_clock(step_s)
            case CutChannel(_, name, peer, for_s):
                hosts = (world.processes[name].host, world.processes[peer].host)
                opens_s = world.now_s + for_s
                world.network.set_channel(*hosts, Channel(open=lambda now_s: now_s >= opens_s))
            case LoseSamples(_, part, for_s):
                world.topics.loss = part
                world.after(for_s, setattr, world.topics, "loss", 0.0)
            case Unplug(_, for_s):
                assert self.brick is not None
                self.brick.plug(False)
                world.after(for_s, self.brick.plug, True)
            case RequestAuthority(_, name, act):
                other = SOURCE if name == RIVAL else RIVAL_SOURCE
                self.grounds[name].request(partial(do, act, other), self.grounds["moe"])
            case _:
                assert_never(deed)

    def _killed(self, process: Process, down_s: float) -> None:
        """Count a kill that happens within this event; judge after it, and start it again."""
        self.kills += 1
        if process.name == "console":
            self._console.killed()
        self._due.add(process.name)
        self.world.after(0.0, self._check)
        self.world.after(down_s, self._restart, process)

    def _restart(self, process: Process) -> None:
        self._due.discard(process.name)
        if not process.alive:
            process.restart()

    def _check(self) -> None:
        self._note(self._authority.check())
        if self.brick is not None:
            self._note(self._mocup.check())
            return
        for address in self.addresses:
            world, journals = seen(self.world, address), self.own[address.suffix]
            self._note(check_stores(world, address.asset, journals))
        if self.page is not None:
            self._note(self._console.check())

    def _watch(self) -> None:
        """Start what ended by itself, as a supervisor does."""
        for process in self.world.processes.values():
            if not process.alive and process.name not in self._due:
                self._due.add(process.name)
                self.world.after(_WATCH_S, self._restart, process)
        self.world.after(_WATCH_S, self._watch)

    def _calm(self) -> None:
        """End all faults."""
        world = self.world
        world.topics.loss = 0.0
        for plan in self._plans.values():
            plan.clear()
        if self.brick is not None:
            self.brick.plug(True)
        for process in world.processes.values():
            process.disk.full = False
            process.resume()
        situation = replace(self._storm.situation, eclipse_s=0.0)
        for address in self.addresses:
            world.network.set_channel(address.orbiter, address.relay, _channel(situation))

    def _check_end(self) -> None:
        world, what = self.world, "a stopped rover moved"
        if self.page is None:  # whose commands have no journal, and which asks for no authority
            self._note(self._authority.check_end())
        if self.brick is not None:
            self._note(self._mocup.check_end())
            return
        for address in self.addresses:
            journals = self.own[address.suffix]
            self._note(check_end(seen(world, address), address.asset, journals))
            if self.page is None:  # which is another sender
                self._note(check_apart(world, address, journals))
        stops = [stop for below in self._below for stop in below.rover.moved]
        self._note(Finding(world.now_s, what, f"stopped by {stop}") for stop in stops)
        if self.page is not None:
            self._note(self._console.check_end())

    def _settled(self) -> bool:
        """Return whether the ground has the end of each command."""
        return (self.page is None or self._console.settled) and all(
            journal.ends.keys() | journal.refused.keys() >= journal.sent.keys()
            for journal in (ground.journal for ground in self.grounds.values())
        )

    def _note(self, findings: Iterator[Finding]) -> None:
        for finding in findings:
            self.findings.setdefault(finding.what, finding)

    def _digest(self) -> str:
        whole = hashlib.sha256(self.world.digest.encode())
        for name, ground in self.grounds.items():
            whole.update(f"{name} {ground.journal}".encode())
        if self.page is not None:
            whole.update(f"{self.page.journal}".encode())
        for process in self.world.processes.values():
            for path in sorted(process.stored.rglob("*")):
                if path.is_file() and _is_repeated(path):
                    whole.update(f"{process.name}/{path.name}".encode())
                    whole.update(_content(path))
        return whole.hexdigest()


def _is_repeated(path: Path) -> bool:
    """Whether a file is the same each time: without stamps of the real disk, and real processes."""
    return "files" not in path.parts and path.suffix != ".lock"


def _content(path: Path) -> bytes:
    match path.suffix:
        case ".sqlite":
            with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as database:
                return "\n".join(database.iterdump()).encode()
        case ".sqlite-wal" | ".sqlite-shm":
            return b""
        case _:
            return path.read_bytes()


def _channel(situation: Situation) -> Channel:
    cycle_s = situation.eclipse_s + situation.contact_s

    def contact(now_s: float) -> bool:
        return not situation.eclipse_s or now_s % cycle_s < situation.contact_s

    return Channel(
        situation.delay_s, situation.jitter_s, situation.loss, situation.duplicate, contact
    )


@contextmanager
def player(storm: Storm, trace: list[str] | None = None) -> Iterator[Player]:
    """Yield what plays a storm; its world is closed at the end.

    It plays in a folder of its own, whose name is in no path: errors say the same each time.
    """
    folder = make_folder()
    try:
        with chdir(folder), redirect_stdout(StringIO()):
            playing = Player(storm, trace)
            with playing.world:
                yield playing
    finally:
        shutil.rmtree(folder)


def play(
    storm: Storm,
    trace: list[str] | None = None,
    *,
    until_found: bool = False,
    quiet_s: float = QUIET_S,
) -> Played:
    """Play a storm to its end, or until a promise is broken; see `Player.play`."""
    with player(storm, trace) as playing:
        return playing.play(until_found=until_found, quiet_s=quiet_s)
