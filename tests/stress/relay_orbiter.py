"""`python -m tests.stress.relay_orbiter`: the orbiter's relay, with commands that never end.

It is `rover-mops` without the MRS: its bundle agent, its records and its rover. What it was given,
took and told is in journals, each line before anything else happens.
"""

import argparse
import asyncio
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Final, TextIO

from adapters.bundle import Delivery, StoreError
from adapters.mal import MalError
from adapters.mops import load_dictionary
from adapters.mrs.spec.errors import AreaError
from adapters.process import exclusive
from adapters.relay.orbiter import load_orbiter
from adapters.relay.orbiter.relay import OrbiterRelay
from adapters.relay.orbiter.rover import RelayedRover
from executive.record import LedgerError
from executive.reports import Report
from executive.state import ParameterValue
from tests.stress.relay_traffic import (
    ASSET,
    EACH_LIFE,
    command_of,
    read_lines,
)

LISTENS: Final = "the orbiter listens"
ASKED: Final = "asked.log"
"""Number of a command that is about to be sent."""
ACKNOWLEDGED: Final = "acknowledged.log"
"""Number of a command that was acknowledged, or known when it was sent again."""
REFUSED: Final = "refused.log"
"""Number of a command that was not, and why."""
TOLD: Final = "told.log"
"""Life, and number of a report that was told to whoever listens."""
GIVEN: Final = "given.log"
"""Life, and identity of a bundle that came down."""
AT_ONCE: Final = 16
MOST_UNDERWAY: Final = 500
"""Commands that are up and not reported on, at most."""
SHARE: Final = 8
"""The same as a part of all, so that the last mishap, too, finds both ways busy."""
LOOK_S: Final = 1.0
PAUSE_S: Final = 0.02


class Journal:
    """Lines of one file, each out of this process's hands when `write` returns."""

    def __init__(self, path: Path) -> None:
        """Go on with the file."""
        self._file: TextIO = path.open("a", encoding="utf-8", buffering=1)

    def write(self, line: str) -> None:
        """Write a line."""
        self._file.write(line + "\n")


class Ground:
    """Sends commands, and hears what is told; the rover's `Listener`.

    Args:
        rover: whom it commands.
        folder: of the journals.
        life: which of the orbiter's lives this is, counted from 0.
        messages: how many commands there are to be, those of earlier lives included.
    """

    def __init__(self, rover: RelayedRover, folder: Path, life: int, messages: int) -> None:
        """Go on where the journals are."""
        self._rover, self._life = rover, life
        self._next = life * EACH_LIFE
        known = {int(line) for line in read_lines(folder / ACKNOWLEDGED)}
        acknowledged = len(known)
        known.update(int(line.split()[0]) for line in read_lines(folder / REFUSED))
        asked = {int(line) for line in read_lines(folder / ASKED)}
        self._again = sorted(asked - known)
        self._left = messages - acknowledged
        self._most_underway = min(MOST_UNDERWAY, messages // SHARE)
        self._underway = max(0, acknowledged - len(read_lines(folder / TOLD)))
        self._asked = Journal(folder / ASKED)
        self._acknowledged = Journal(folder / ACKNOWLEDGED)
        self._refused = Journal(folder / REFUSED)
        self._told = Journal(folder / TOLD)
        rover.listener = self

    def report(self, report: Report) -> None:
        """Hear a report, unless it is of the relay itself."""
        if report.sequence:
            self._told.write(f"{self._life} {report.sequence}")
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
        self._asked.write(str(self._next))
        return self._next

    async def _send_one(self, number: int) -> None:
        try:
            await self._rover.submit(command_of(number))
        except (MalError, StoreError, LedgerError) as error:
            if isinstance(error, MalError) and error.number == AreaError.DUPLICATE.value:
                self._acknowledged.write(str(number))
                return
            self._refused.write(f"{number} {error!r}")
            self._left += 1
            self._underway -= 1
            await asyncio.sleep(LOOK_S)
        else:
            self._acknowledged.write(str(number))


class Witness(OrbiterRelay):
    """The relay, which also writes down which bundles it is given."""

    def watch(self, folder: Path, life: int) -> None:
        """Write it down from now on."""
        self._given, self._life = Journal(folder / GIVEN), life

    def _hear(self, delivery: Delivery) -> None:
        self._given.write(f"{self._life} {delivery.identity}")
        super()._hear(delivery)


async def serve(settings_file: Path, data: Path, folder: Path, life: int, messages: int) -> None:
    """Relay until this process ends."""
    with exclusive(data, "orbiter.lock"):
        relay = Witness(load_orbiter(settings_file), data, None, load_dictionary())
        relay.watch(folder, life)
        await relay.open()
        (rover,) = relay.rovers.values()
        ground = Ground(rover, folder, life, messages)
        print(LISTENS, flush=True)
        async with asyncio.TaskGroup() as group:
            group.create_task(relay.receive())
            group.create_task(ground.send())
            while True:
                try:
                    relay.look()
                except LedgerError as error:
                    logging.getLogger(ASSET).error("%s", error)
                await asyncio.sleep(LOOK_S)


def main() -> None:
    """Serve."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--folder", type=Path, required=True)
    parser.add_argument("--life", type=int, required=True)
    parser.add_argument("--messages", type=int, required=True)
    told = parser.parse_args()
    logging.basicConfig(level="INFO", format="%(levelname)-7s %(message)s")
    asyncio.run(serve(told.config, told.data, told.folder, told.life, told.messages))


if __name__ == "__main__":
    main()
