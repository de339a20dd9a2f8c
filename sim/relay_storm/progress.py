"""How far a storm has come, by the journals and records that grow."""

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from sim.relay_storm import orbiter, rover
from sim.relay_storm.traffic import ASSET, read_lines

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
        acknowledged = len(read_lines(folder / orbiter.ACKNOWLEDGED))
        done, known = _reports(folder / rover.LEDGER), _reports(disk / f"{ASSET}.sqlite")
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
