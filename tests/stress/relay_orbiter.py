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
    ASSET,
    EACH_RUN,
    GIVEN,
    ORBITER_JOURNAL,
    REFUSED,
    REPORTED,
    REQUESTED,
    command_of,
)

LISTENS: Final = "the orbiter listens"
AT_ONCE: Final = 16
MAX_UNDERWAY: Final = 500
"""Commands that are up and not reported on, at most."""
SHARE: Final = 8
"""The same as a part of all, so that the last fault, too, finds both ways busy."""
POLL_S: Final = 1.0
PAUSE_S: Final = 0.02


class Ground:
    """Sends commands, and hears what is told; the rover's `Listener`.

    Args:
        rover: whom it commands.
        run: which of the orbiter's lives this is, counted from 0.
        messages: how many commands there are to be, those of earlier lives included.
    """

    def __init__(self, rover: RelayedRover, journal: Journal, run: int, messages: int) -> None:
        def numbers(kind: str) -> list[int]:
            return [row[1] for row in journal.rows if row[0] == kind]

        self._rover, self._journal, self._run = rover, journal, run
        self._next = run * EACH_RUN
        acknowledged = set(numbers(ACKNOWLEDGED))
        self._again = sorted(set(numbers(REQUESTED)) - acknowledged - set(numbers(REFUSED)))
        self._left = messages - len(acknowledged)
        self._max_underway = min(MAX_UNDERWAY, messages // SHARE)
        self._underway = max(0, len(acknowledged) - len(numbers(REPORTED)))
        rover.listener = self

    def on_report(self, report: Report, cursor: int | None) -> None:
        """Hear a report, unless it is of the relay itself."""
        if report.sequence:
            self._journal.write(REPORTED, self._run, report.sequence)
            self._underway -= 1

    def on_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Hear telemetry, which is nothing to this."""

    async def send(self) -> None:
        """Send commands, many at once, as many as there are to be.

        First once more, as a ground does, those over which the orbiter was killed.
        """
        await asyncio.gather(*(self._send_some() for _ in range(AT_ONCE)))

    async def _send_some(self) -> None:
        while self._left > 0:
            if self._underway >= self._max_underway:
                await asyncio.sleep(PAUSE_S)
                continue
            self._left -= 1
            self._underway += 1
            await self._send_one(self._number())

    def _number(self) -> int:
        if self._again:
            return self._again.pop()
        self._next += 1
        self._journal.write(REQUESTED, self._next)
        return self._next

    async def _send_one(self, number: int) -> None:
        try:
            await self._rover.submit(command_of(number))
        except (MalError, StoreError, LedgerError) as error:
            if not isinstance(error, MalError) or error.number != AreaError.DUPLICATE.value:
                self._journal.write(REFUSED, number, repr(error))
                self._left += 1
                self._underway -= 1
                await asyncio.sleep(POLL_S)
                return
        self._journal.write(ACKNOWLEDGED, number)


class Witness(OrbiterRelay):
    """The relay, which also writes down which bundles it is given."""

    def watch(self, journal: Journal, run: int) -> None:
        self._journal, self._run = journal, run

    def _on_delivery(self, delivery: Delivery) -> None:
        self._journal.write(GIVEN, self._run, str(delivery.identity))
        super()._on_delivery(delivery)


async def serve(settings_file: Path, data: Path, folder: Path, run: int, messages: int) -> None:
    with exclusive(data, "orbiter.lock"):
        journal = Journal(folder / ORBITER_JOURNAL)
        relay = Witness(load_orbiter(settings_file), data, lambda: None, load_dictionary())
        relay.watch(journal, run)
        await relay.open()
        (rover,) = relay.rovers.values()
        ground = Ground(rover, journal, run, messages)
        print(LISTENS, flush=True)
        async with asyncio.TaskGroup() as group:
            group.create_task(relay.receive())
            group.create_task(ground.send())
            while True:
                try:
                    relay.poll()
                except LedgerError as error:
                    logging.getLogger(ASSET).error("%s", error)
                await asyncio.sleep(POLL_S)


if __name__ == "__main__":
    logging.basicConfig(level="INFO", format="%(levelname)-7s %(message)s")
    settings, own_data, journals = map(Path, sys.argv[1:4])
    asyncio.run(serve(settings, own_data, journals, *map(int, sys.argv[4:6])))
