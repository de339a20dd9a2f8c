"""Messages both ways over a bad link between processes that are killed: is one lost, or doubled?"""

import tempfile
from collections import Counter
from pathlib import Path
from typing import Final

from sim.bench.figures import Figure, Goal
from sim.processes.place import free_place
from sim.relay_storm.campaign import Remains, Tell, storm
from sim.relay_storm.judge import Fault, Verdict, gather, judge
from sim.relay_storm.mishaps import Mishap, Plan

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
        verdict = judge(gather(remains.folder, remains.record, remains.relay_killed_s))
        for fault, about in verdict.faults[:TOLD_FAULTS]:
            tell(f"{fault.value}: {about}")
        if remains.no_disk:
            tell(f"no disk was filled, for none can be made here: {remains.no_disk}")
        return _figures(plan, remains, verdict)


def _figures(plan: Plan, remains: Remains, verdict: Verdict) -> list[Figure]:
    beside = f"{plan.messages} each way, {plan.loss:.0%} loss, seed {plan.seed}"
    happened, faults = Counter(remains.happened), Counter(fault for fault, _ in verdict.faults)
    rate = verdict.commands / remains.duration_s
    return [
        *(Figure(f"relay: {each.value}", happened[each], "times") for each in Mishap),
        *(Figure(f"relay: {_LINK[kind]}", n, "") for kind, n in remains.link.items()),
        Figure("relay: writes that a full disk refused", remains.unwritten, "lines", "of the logs"),
        Figure("relay: duration", remains.duration_s, "s", beside),
        Figure("relay: messages each way, all mishaps included", rate, "1/s", beside),
        Figure("relay: commands at the topic", verdict.commands, "", "", Goal(plan.messages, True)),
        Figure("relay: of these not acknowledged", verdict.unacknowledged, ""),
        Figure(
            "relay: published again after a kill", verdict.published_again, "", "the ledger knows"
        ),
        Figure("relay: bundles given again after a kill", verdict.given_again, "", "record knows"),
        Figure("relay: reports in two bundles", verdict.told_again, "", "known by their number"),
        Figure("relay: reports kept, the orbiter killed before telling", verdict.untold, ""),
        *(Figure(f"relay: {each.value}", faults[each], "", beside, Goal(0)) for each in Fault),
    ]
