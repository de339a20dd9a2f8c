"""kill -9 for client, broker and executive at random moments: does the client know the truth?

client ── commands, files ──▶ executive ══ ROS ══ rover-sim ── truth ──▶ observer
   ▲                              │ registers, publishes
   └── notifications ── broker ◀──┘      (docs/two-rovers.md: an executive of its own)"""

import re
import socket
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from executive.record.ledger import Ledger
from executive.reports import Identity
from executive.settings import config_folder
from sim.processes.children import Child
from sim.processes.deployment import LISTENS
from sim.processes.place import ANY_PORT, HOST, Place, free_place
from tests.benchmarks.figures import Figure, Goal
from tests.stress.command_generator import ERRANDS, errand_path
from tests.stress.kills_client import (
    ASSET,
    COMMANDS,
    JOURNAL,
    SAMPLES,
    SETTLED,
)
from tests.stress.kills_journal import (
    Answer,
    Answered,
    Entry,
    Fetched,
    Fetching,
    Heard,
    Journal,
    Sent,
    Way,
)
from tests.stress.kills_judge import (
    Evidence,
    Fault,
    judge,
    stops,
)
from tests.stress.pose_log import read_poses

BROKER: Final = "base"
"""The asset whose executive is the service layer, with the broker; it has no rover."""
SAMPLE_OCTETS: Final = 6_000_000
START_S: Final = 60.0
SETTLE_S: Final = 120.0
STAND_S: Final = 2.0
LOOK_S: Final = 0.05
PAUSE_S: Final = 2.5
"""At most between two kills."""
HASTE: Final = 0.3
"""Of the kills: without waiting for what was killed before to be up again."""
Tell = Callable[[str], None]


@unique
class Victim(Enum):
    """What is killed."""

    CLIENT = "client"
    BROKER = "broker"
    EXECUTIVE = "executive"


@dataclass(frozen=True, slots=True)
class Artifacts:
    """What is left on disk.

    Attributes:
        ledger: of the executive.
        files: the folder aboard.
        journal: the client's.
        sightings: the observer's log.
        duration_s: how long kills came.
        restarts_utc_s: when the executive was killed and started again.
    """

    ledger: Path
    files: Path
    journal: Path
    sightings: Path
    duration_s: float
    restarts_utc_s: tuple[float, ...]


class _Part:
    """A process that is started again and again."""

    def __init__(
        self, name: str, module: str, line: Sequence[str], site: "_Site", up: re.Pattern[str]
    ) -> None:
        self._up = up
        self._name = name
        self._module = module
        self._line = line
        self._site = site
        self._count = 0
        self.child = self.start()

    def start(self, *more: str) -> Child:
        self._count += 1
        name, line = f"{self._name}-{self._count}", (*self._line, *more)
        site = self._site
        self.child = Child(name, self._module, line, site.folder, site.environment)
        return self.child

    def wait(self) -> None:
        """Return when it is up."""
        _wait(self.child, self._up, START_S)


@dataclass(frozen=True, slots=True)
class _Site:
    folder: Path
    environment: dict[str, str]


def kill_at_random(
    place: Place, folder: Path, victims: Sequence[Victim], seed: int, tell: Tell
) -> Artifacts:
    """Kill at random moments, let all settle, and return what is left.

    Args:
        place: a ROS domain that nobody else uses.
        folder: empty; logs, ledger, journal and files go there.
        victims: whom, in this order.
        seed: of the moments, and of what is commanded.
        tell: called with a line on each kill.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: the processes did not start, or the client did not settle.
    """
    ground, aboard = folder / "ground", folder / "aboard"
    ground.mkdir()
    _provide(aboard / "files", Random(seed))
    site = _Site(folder, {"ROS_DOMAIN_ID": str(place.domain)})
    with _parts(site, aboard, ground, seed) as (parts, observer):
        began_s = time.monotonic()
        random, restarts_utc_s = Random(seed), list[float]()
        for number, victim in enumerate(victims, 1):
            hasty = random.random() < HASTE
            for part in parts.values():
                part.child.check()
                if not hasty:
                    part.wait()
            time.sleep(random.uniform(0.0, PAUSE_S))
            parts[victim].child.kill()
            tell(f"{time.monotonic() - began_s:6.1f} s  kill {number}: {victim.value}")
            parts[victim].start()
            if victim is Victim.EXECUTIVE:
                restarts_utc_s.append(time.time())
        duration_s = time.monotonic() - began_s
        client = parts[Victim.CLIENT]
        client.child.kill()
        client.start("--finish")
        _wait(client.child, re.compile(SETTLED), SETTLE_S)
        time.sleep(STAND_S)
        parts[Victim.EXECUTIVE].child.kill()
    ledger, files, journal = aboard / "ledger.sqlite", aboard / "files", ground / JOURNAL
    restarts = tuple(restarts_utc_s)
    return Artifacts(ledger, files, journal, observer.log, duration_s, restarts)


@contextmanager
def _parts(
    site: _Site, aboard: Path, ground: Path, seed: int
) -> Iterator[tuple[dict[Victim, _Part], Child]]:
    rover, broker, video_from, video_to = (f"{HOST}:{port}" for port in _free_ports(4))
    for suffix in (".yaml", ".ros.yaml"):
        text = (config_folder() / f"{ASSET}{suffix}").read_text(encoding="utf-8")
        named = text.replace(f"asset: {ASSET}", f"asset: {BROKER}")
        (site.folder / f"{BROKER}{suffix}").write_text(named, encoding="utf-8")
    running: list[_Part] = []

    def part(name: str, module: str, *line: str, up: re.Pattern[str] = LISTENS) -> _Part:
        running.append(_Part(name, module, line, site, up))
        return running[-1]

    try:
        part("simulation", "sim.ros.process", "--asset", ASSET, "--world", "flat")
        observer = part("observer", "tests.stress.pose_log", ASSET).child
        parts = {
            Victim.BROKER: part(
                "broker",
                "adapters.onboard.process",
                *("--asset", str(site.folder / f"{BROKER}.yaml")),
                *("--ros-params", str(site.folder / f"{BROKER}.ros.yaml")),
                *("--port", _port(broker), "--data", str(site.folder / BROKER)),
            ),
            Victim.EXECUTIVE: part(
                "executive",
                "adapters.onboard.process",
                *("--asset", ASSET, "--port", _port(rover), "--data", str(aboard)),
                *("--service-layer", broker),
                *("--video-from", video_from, "--video-to", video_to),
            ),
        }
        for each in parts.values():
            each.wait()
        parts[Victim.CLIENT] = part(
            "client",
            "tests.stress.kills_client",
            *("--rover", rover, "--broker", broker),
            *("--folder", str(ground), "--seed", str(seed)),
            up=re.compile(COMMANDS),
        )
        yield parts, observer
    finally:
        for each in reversed(running):
            each.child.kill()


def _wait(child: Child, pattern: re.Pattern[str], limit_s: float) -> None:
    deadline_s = time.monotonic() + limit_s
    while child.said(pattern) is None:
        child.check()
        if time.monotonic() > deadline_s:
            text = f"{child.name} does not say {pattern.pattern!r} after {limit_s:.0f} s"
            raise TimeoutError(text)
        time.sleep(LOOK_S)


def _provide(files: Path, random: Random) -> None:
    """Put files aboard: large ones to be fetched, small ones to be moved and deleted."""
    for sample in SAMPLES:
        _write(files / sample, random.randbytes(SAMPLE_OCTETS))
    for number in range(ERRANDS):
        _write(files / errand_path(number), b"errand\n")


def _write(path: Path, octets: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(octets)


def _free_ports(count: int) -> list[int]:
    probes = [socket.create_server((HOST, ANY_PORT)) for _ in range(count)]
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


def _port(address: str) -> str:
    return address.rpartition(":")[2]


TOLD_FAULTS: Final = 10
LEAST: Final = 2
"""Commands for each kill, so that kills have something to meet."""


def measure(kills: int, seed: int, tell: Tell, keep: Path | None = None) -> list[Figure]:
    """Return how often a promise was broken, and what the campaign came upon.

    Must be called on the main thread, which no other thread may run beside yet.

    Args:
        kills: how many, shared out evenly.
        seed: of everything random.
        tell: called with a line on each kill and on each of the first faults.
        keep: an empty folder where everything is left; None for one that is gone in the end.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: the processes did not start, or the client did not settle.
    """
    victims = [list(Victim)[number % len(Victim)] for number in range(kills)]
    Random(seed).shuffle(victims)
    with free_place() as place, tempfile.TemporaryDirectory(prefix="rover-kills-") as passing:
        folder = keep or Path(passing)
        remains = kill_at_random(place, folder, victims, seed, tell)
        evidence = gather(remains)
        faults = judge(evidence)
        for fault, about in faults[:TOLD_FAULTS]:
            tell(f"{fault.value}: {about}")
        counts = Counter(fault for fault, _ in faults)
        beside = f"{kills} kills, seed {seed}"
        return [
            *(Figure(f"kills: {each.value}", victims.count(each), "kills") for each in Victim),
            Figure("kills: duration", remains.duration_s, "s", beside),
            *_course(evidence, kills),
            Figure("kills: restarts while stopped", _stopped(remains, evidence), "times"),
            *(Figure(f"kills: {each.value}", counts[each], "", beside, Goal(0)) for each in Fault),
        ]


def gather(remains: Artifacts) -> Evidence:
    """Read what a campaign left."""
    ledger = Ledger(remains.ledger)
    reports = ledger.reports(count=ledger.last_sequence)
    ledger.close()
    with Journal(remains.journal) as journal:
        entries = journal.entries
    sightings = read_poses(remains.sightings)
    return Evidence(entries, reports, sightings, remains.files)


def _course(evidence: Evidence, kills: int) -> list[Figure]:
    journal = evidence.journal
    sent = [entry.command.identity for entry in journal if isinstance(entry, Sent)]
    return [
        Figure("kills: commands", len(set(sent)), "commands", "", Goal(LEAST * kills, True)),
        Figure("kills: sent again", len(sent) - len(set(sent)), "times"),
        *(
            Figure(f"kills: answered {answer.value}", _count(journal, answer), "commands")
            for answer in Answer
        ),
        Figure("kills: taken, the answer lost", _answers_lost(journal), "commands"),
        Figure("kills: reports", len(evidence.reports), "reports"),
        *(Figure(f"kills: heard, {way.value}", _count(journal, way), "reports") for way in Way),
        Figure("kills: files fetched", _fetched(journal), "files"),
        Figure("kills: transfers a later client ended", _resumed(journal), "times"),
        Figure("kills: times stopped", len(stops(evidence)), "times"),
    ]


def _stopped(remains: Artifacts, evidence: Evidence) -> int:
    """Count the executives that had to know that there was a stop before they were."""
    return sum(
        begin_s < restart_s < end_s
        for restart_s in remains.restarts_utc_s
        for begin_s, end_s in stops(evidence)
    )


def _count(journal: Sequence[Entry], what: Answer | Way) -> int:
    return sum(
        (isinstance(entry, Answered) and entry.answer is what)
        or (isinstance(entry, Heard) and entry.way is what)
        for entry in journal
    )


def _answers_lost(journal: Sequence[Entry]) -> int:
    """Count the commands whose first answer is Duplicate: the rover had taken them before."""
    first: dict[Identity, Answer] = {}
    for entry in journal:
        if isinstance(entry, Answered):
            first.setdefault(entry.identity, entry.answer)
    return sum(answer is Answer.DUPLICATE for answer in first.values())


def _fetched(journal: Sequence[Entry]) -> int:
    return sum(isinstance(entry, Fetched) for entry in journal)


def _resumed(journal: Sequence[Entry]) -> int:
    return sum(isinstance(entry, Fetching) and entry.had_octets > 0 for entry in journal)
