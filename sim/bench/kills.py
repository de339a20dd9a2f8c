"""kill -9 for client, broker and executive at random moments: does the client know the truth?"""

import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Final

from executive.commands import Identity
from executive.ledger import Ledger
from sim.bench.figures import Figure, Goal
from sim.kills.campaign import Remains, Tell, Victim, kill_at_random
from sim.kills.journal import Answer, Answered, Entry, Fetched, Fetching, Heard, Journal, Sent, Way
from sim.kills.judge import Evidence, Fault, judge, stops
from sim.kills.sightings import read_sightings
from sim.processes.place import free_place

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


def gather(remains: Remains) -> Evidence:
    """Read what a campaign left."""
    ledger = Ledger(remains.ledger)
    reports = ledger.reports(count=ledger.last_sequence)
    ledger.close()
    with Journal(remains.journal) as journal:
        entries = journal.entries
    sightings = read_sightings(remains.sightings)
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


def _stopped(remains: Remains, evidence: Evidence) -> int:
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
