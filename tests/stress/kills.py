"""kill -9 for client, broker and executive at random moments: does the client know the truth?

client ── commands, files ──▶ executive ══ ROS ══ rover-sim ── truth ──▶ observer
   ▲                              │ registers, publishes
   └── notifications ── broker ◀──┘      (docs/two-rovers.md: an executive of its own)
"""

import re
import time
from collections import Counter
from collections.abc import Sequence
from enum import Enum, unique
from pathlib import Path
from random import Random
from typing import Final

from executive.record import Ledger
from executive.settings import config_folder
from sim.processes import HOST
from tests.stress.command_generator import SMALL_FILES, small_file
from tests.stress.findings import Findings, LifecycleFault, Log
from tests.stress.kills_client import ASSET, COMMANDS, JOURNAL, SAMPLES, SETTLED
from tests.stress.kills_journal import (
    Answer,
    Answered,
    Entry,
    Fetched,
    Fetching,
    Received,
    Route,
    Sent,
    read_entries,
)
from tests.stress.kills_judge import Evidence, Fault, judge, stops
from tests.stress.pose_log import read_poses
from tests.support.figures import Figure, Goal
from tests.support.ports import free_ports
from tests.support.victims import Victim, Workplace, workplace

BROKER: Final = "base"
"""The asset whose executive is the service layer, with the broker; it has no rover."""
SAMPLE_OCTETS: Final = 6_000_000
SETTLE_S: Final = 120.0
STANDSTILL_S: Final = 2.0
PAUSE_S: Final = 2.5
"""At most between two kills."""
HASTE: Final = 0.3
"""Of the kills: without waiting for what was killed before to be up again."""
LEAST: Final = 2
"""Commands for each kill, so that kills have something to meet."""


@unique
class Target(Enum):
    """What is killed."""

    CLIENT = "client"
    BROKER = "broker"
    EXECUTIVE = "executive"


def measure(kills: int, seed: int, log: Log, output: Path | None = None) -> list[Figure]:
    """Return how often a promise was broken, and what the campaign came upon.

    Args:
        kills: how many, shared out evenly.
        seed: of the moments, and of what is commanded.
        log: called with a line on each kill and on each of the first faults.
        output: an empty folder where everything is left; None for one that is gone in the end.

    Raises:
        ChildError: a process ended by itself.
        TimeoutError: the processes did not start, or the client did not settle.
    """
    targets = [list(Target)[number % len(Target)] for number in range(kills)]
    Random(seed).shuffle(targets)
    with workplace(output) as workspace:
        ground, aboard = workspace.folder / "ground", workspace.folder / "aboard"
        ground.mkdir()
        _provide_files(aboard / "files", Random(seed))
        observer = workspace.start("observer", "tests.stress.pose_log", ASSET)
        duration_s = _kill_at_random(workspace, ground, aboard, targets, seed, log)
        poses, journal = read_poses(observer.child.log), read_entries(ground / JOURNAL)
        ledger = Ledger(aboard / "ledger.sqlite")
        reports = ledger.reports(count=ledger.last_sequence)
        ledger.close()
        evidence = Evidence(journal, reports, poses, aboard / "files")
        findings = Findings(log, judge(evidence))
    beside = f"{kills} kills, seed {seed}"
    return [
        *(Figure(f"kills: {each.value}", targets.count(each), "kills") for each in Target),
        Figure("kills: duration", duration_s, "s", beside),
        *_journal_figures(journal, kills),
        Figure("kills: reports", len(reports), "reports"),
        Figure("kills: times stopped", len(stops(evidence)), "times"),
        *findings.figures("kills", Fault, beside),
        *findings.figures("kills", LifecycleFault, beside),
    ]


def _kill_at_random(
    workspace: Workplace, ground: Path, aboard: Path, targets: Sequence[Target], seed: int, log: Log
) -> float:
    """Kill so many, have the client settle, and return how long kills came."""
    victims = _start(workspace, ground, aboard, seed)
    began_s = time.monotonic()
    random = Random(seed)
    for number, target in enumerate(targets, 1):
        hasty = random.random() < HASTE
        workspace.check()
        for victim in victims.values():
            if not hasty:
                victim.wait()
        time.sleep(random.uniform(0.0, PAUSE_S))
        victims[target].restart()
        log(f"{time.monotonic() - began_s:6.1f} s  kill {number}: {target.value}")
    duration_s = time.monotonic() - began_s
    victims[Target.CLIENT].restart("--finish")
    victims[Target.CLIENT].wait(SETTLED, SETTLE_S)
    time.sleep(STANDSTILL_S)
    victims[Target.EXECUTIVE].child.kill()
    return duration_s


def _start(workspace: Workplace, ground: Path, aboard: Path, seed: int) -> dict[Target, Victim]:
    rover, broker, video_from, video_to = (f"{HOST}:{port}" for port in free_ports(4))
    for suffix in (".yaml", ".ros.yaml"):
        text = (config_folder() / f"{ASSET}{suffix}").read_text(encoding="utf-8")
        named = text.replace(f"asset: {ASSET}", f"asset: {BROKER}")
        (workspace.folder / f"{BROKER}{suffix}").write_text(named, encoding="utf-8")
    workspace.start("simulation", "sim.ros.process", "--asset", ASSET, "--world", "flat")
    victims = {
        Target.BROKER: workspace.start(
            "broker", "adapters.onboard.process",
            "--asset", workspace.folder / f"{BROKER}.yaml",
            "--ros-params", workspace.folder / f"{BROKER}.ros.yaml",
            "--port", _port(broker), "--data", workspace.folder / BROKER,
        ),
        Target.EXECUTIVE: workspace.start(
            "executive", "adapters.onboard.process",
            "--asset", ASSET, "--port", _port(rover), "--data", aboard, "--service-layer", broker,
            "--video-from", video_from, "--video-to", video_to,
        ),
    }  # fmt: skip
    for each in victims.values():
        each.wait()
    victims[Target.CLIENT] = workspace.start(
        "client", "tests.stress.kills_client",
        "--rover", rover, "--broker", broker, "--folder", ground, "--seed", seed,
        up=re.escape(COMMANDS),
    )  # fmt: skip
    return victims


def _provide_files(files: Path, random: Random) -> None:
    """Put files aboard: large ones to be fetched, small ones to be moved and deleted."""
    octets = {sample: random.randbytes(SAMPLE_OCTETS) for sample in SAMPLES}
    octets |= {small_file(number): b"small\n" for number in range(SMALL_FILES)}
    for name, content in octets.items():
        (files / name).parent.mkdir(parents=True, exist_ok=True)
        (files / name).write_bytes(content)


def _port(address: str) -> str:
    return address.rpartition(":")[2]


def _journal_figures(journal: Sequence[Entry], kills: int) -> list[Figure]:
    sent = [entry.command.identity for entry in journal if isinstance(entry, Sent)]
    answers = Counter(entry.answer for entry in journal if isinstance(entry, Answered))
    routes = Counter(entry.route for entry in journal if isinstance(entry, Received))
    fetched = sum(isinstance(entry, Fetched) for entry in journal)
    resumed = sum(isinstance(entry, Fetching) and entry.had_octets > 0 for entry in journal)
    return [
        Figure("kills: commands", len(set(sent)), "commands", "", Goal(LEAST * kills, True)),
        Figure("kills: sent again", len(sent) - len(set(sent)), "times"),
        *(Figure(f"kills: answered {each.value}", answers[each], "commands") for each in Answer),
        *(Figure(f"kills: heard, {each.value}", routes[each], "reports") for each in Route),
        Figure("kills: files fetched", fetched, "files"),
        Figure("kills: transfers a later client ended", resumed, "times"),
    ]
