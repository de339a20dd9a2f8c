"""The orbiter's relay, with commands that never end.

`python -m tests.stress.relay_orbiter SETTINGS DATA FOLDER LIFE MESSAGES`

It is `rover-mops` without the MRS: its bundle agent, its records and its rover. What it was given,
took and told is in a journal, each row before anything else happens.
"""

import asyncio
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from adapters.bundle import Delivery, StoreError
from adapters.mal import MalError
from adapters.mops import load_dictionary
from adapters.mrs.spec import AreaError
from adapters.process import exclusive
from adapters.relay.orbiter import load_orbiter
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.orbiter.rover import RelayedRover
from executive.record import LedgerError
from executive.values.parameters import ParameterValue
from executive.values.reports import Report
from tests.stress.journal import Journal
from tests.stress.relay_traffic import (
    ACKNOWLEDGED,
    ASKED,
    ASSET,
    EACH_LIFE,
    GIVEN,
    ORBITER_JOURNAL,
    REFUSED,
    TOLD,
    command_of,
)

LISTENS: Final = "the orbiter listens"
AT_ONCE: Final = 16
MOST_UNDERWAY: Final = 500
"""Commands that are up and not reported on, at most."""
SHARE: Final = 8
"""The same as a part of all, so that the last fault, too, finds both ways busy."""
LOOK_S: Final = 1.0
PAUSE_S: Final = 0.02


class Ground:
    """Sends commands, and hears what is told; the rover's `Listener`.

    Args:
        rover: whom it commands.
        life: which of the orbiter's lives this is, counted from 0.
        messages: how many commands there are to be, those of earlier lives included.
    """

    def __init__(self, rover: RelayedRover, journal: Journal, life: int, messages: int) -> None:
        def numbers(kind: str) -> list[int]:
            return [row[1] for row in journal.rows if row[0] == kind]

        self._rover, self._journal, self._life = rover, journal, life
        self._next = life * EACH_LIFE
        acknowledged = set(numbers(ACKNOWLEDGED))
        self._again = sorted(set(numbers(ASKED)) - acknowledged - set(numbers(REFUSED)))
        self._left = messages - len(acknowledged)
        self._most_underway = min(MOST_UNDERWAY, messages // SHARE)
        self._underway = max(0, len(acknowledged) - len(numbers(TOLD)))
        rover.listener = self

    def report(self, report: Report, cursor: int | None) -> None:
        """Hear a report, unless it is of the relay itself."""
        if report.sequence:
            self._journal.write(TOLD, self._life, report.sequence)
            self._underway -= 1

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Hear telemetry, which is nothing to this."""

    async def send(self) -> None:
        """Send commands, many at once, as many as there are to be.

        First once more, as a ground does, those over which the orbiter was killed.
        """
        await asyncio.gather(*(self._send_some() for _ in range(AT_ONCE)))

    async def _send_some(self) -> None:
        while self._left > 0:
            if self._underway >= self._most_underway:
                await asyncio.sleep(PAUSE_S)
                continue
            self._left -= 1
            self._underway += 1
            await self._send_one(self._number())

    def _number(self) -> int:
        if self._again:
            return self._again.pop()
        self._next += 1
        self._journal.write(ASKED, self._next)
        return self._next

    async def _send_one(self, number: int) -> None:
        try:
            await self._rover.submit(command_of(number))
        except (MalError, StoreError, LedgerError) as error:
            if not isinstance(error, MalError) or error.number != AreaError.DUPLICATE.value:
                self._journal.write(REFUSED, number, repr(error))
                self._left += 1
                self._underway -= 1
                await asyncio.sleep(LOOK_S)
                return
        self._journal.write(ACKNOWLEDGED, number)


class Witness(OrbiterRelay):
    """The relay, which also writes down which bundles it is given."""

    def watch(self, journal: Journal, life: int) -> None:
        self._journal, self._life = journal, life

    def _on_delivery(self, delivery: Delivery) -> None:
        self._journal.write(GIVEN, self._life, str(delivery.identity))
        super()._on_delivery(delivery)


async def serve(settings_file: Path, data: Path, folder: Path, life: int, messages: int) -> None:
    with exclusive(data, "orbiter.lock"):
        journal = Journal(folder / ORBITER_JOURNAL)
        relay = Witness(load_orbiter(settings_file), data, lambda: None, load_dictionary())
        relay.watch(journal, life)
        await relay.open()
        (rover,) = relay.rovers.values()
        ground = Ground(rover, journal, life, messages)
        print(LISTENS, flush=True)
        async with asyncio.TaskGroup() as group:
            group.create_task(relay.receive())
            group.create_task(ground.send())
            while True:
                try:
                    relay.poll()
                except LedgerError as error:
                    logging.getLogger(ASSET).error("%s", error)
                await asyncio.sleep(LOOK_S)


if __name__ == "__main__":
    logging.basicConfig(level="INFO", format="%(levelname)-7s %(message)s")
    settings, own_data, journals = map(Path, sys.argv[1:4])
    asyncio.run(serve(settings, own_data, journals, *map(int, sys.argv[4:6])))
