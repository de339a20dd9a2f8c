"""A storm from its begin until all has settled, and what is left of it."""

import shutil
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Final

from sim.processes.place import Place
from sim.relay_storm import rover
from sim.relay_storm.mishaps import Mishap, Plan, mishaps
from sim.relay_storm.progress import Progress, settle
from sim.relay_storm.site import disks, site
from sim.relay_storm.traffic import ASSET

HASTE_S: Final = 0.3
"""Between the progress that calls for a mishap and the mishap, at most."""
ORBITER_RECORD: Final = "orbiter.sqlite"
FULL: Final = "disk is full"
"""As SQLite says it."""
Tell = Callable[[str], None]


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
        unwritten: how often processes logged that a disk took nothing.
        no_disk: why no disk could be filled; nothing if they were.
    """

    folder: Path
    record: Path
    duration_s: float
    relay_killed_s: tuple[float, ...]
    happened: tuple[Mishap, ...]
    link: dict[str, int]
    unwritten: int
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
        both, no_disk = disks(stack, folder)
        running = stack.enter_context(site(place, folder, both, plan))
        began_s, killed_s = time.monotonic(), list[float]()
        progress = Progress(folder / rover.TOPIC)
        random, happened = Random(plan.seed), list[Mishap]()
        for at, mishap in mishaps(plan, random, bool(no_disk)):
            if not progress.reaches(at, running.check):
                tell(f"nothing comes any more after {progress.count} messages")
                break
            time.sleep(random.uniform(0.0, HASTE_S))
            tell(f"{time.monotonic() - began_s:6.1f} s {progress.count:6d}  {mishap.value}")
            happened.append(mishap)
            if mishap in (Mishap.KILL_RELAY, Mishap.DIE_RELAY):
                killed_s.append(time.monotonic())
            running.befall(mishap)
        settle(folder, both.orbiter.folder, plan.messages, progress, running.check)
        duration_s = time.monotonic() - began_s
        link = running.end()
        for path in both.orbiter.folder.glob(f"{ASSET}.sqlite*"):
            shutil.copy(path, folder / path.name.replace(ASSET, "orbiter"))
        return Remains(
            folder=folder,
            record=folder / ORBITER_RECORD,
            duration_s=duration_s,
            relay_killed_s=tuple(killed_s),
            happened=tuple(happened),
            link=link,
            unwritten=sum(path.read_text().count(FULL) for path in folder.glob("*-*.log")),
            no_disk=no_disk,
        )
