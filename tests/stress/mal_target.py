"""The provider that is fuzzed: a rover in lock step and its link, as a process of its own."""

import asyncio
import gc
import logging
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from math import hypot
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import Final

import psutil

from adapters.mal import Connection, Encoding
from adapters.mrs.link import MrsLink
from adapters.mrs.transport import TransportSettings
from executive.settings import Settings
from executive.values.geometry import STANDING
from executive.values.reports import Stage
from sim.rover import World
from sim.rover.camera import PictureSettings
from sim.rover.faults import OdometryLost
from sim.rover.lockstep import LockStep
from tests.stress.findings import Lines, resident_mb

FILE: Final = "fuzz.bin"
FILE_OCTETS: Final = 100_000
_TURN_S: Final = 0.01
"""Real time from tick to tick: five times as fast as the rover's."""
STILL_M: Final = 0.01
_MAX_ERRORS: Final = 5
PICTURE: Final = PictureSettings(width=16, height=12)


@dataclass(frozen=True, slots=True)
class Options:
    """What the target is.

    Attributes:
        held: whether it may not move at all: it has no odometry.
        folder: for its ledger and files.
        prepare: called before anything else; tests break the provider there.
    """

    encoding: Encoding
    held: bool
    folder: Path
    prepare: Callable[[], None]


@dataclass(frozen=True, slots=True)
class Sample:
    """What only the process itself can say.

    Attributes:
        moved: turns with a velocity that no command under way accounts for.
        admitted: source and number of every command that was accepted.
        errors: the first lines that were logged as errors.
        error_count: how many there were.
        resident_mb: what it holds in memory.
        files: its open file descriptors, sockets included.
        tasks: asyncio tasks that are not done.
        open: connections that are open.
        stored: connections that somebody still holds, open or not.
    """

    moved: int
    admitted: frozenset[tuple[str, int]]
    errors: tuple[str, ...]
    error_count: int
    resident_mb: float
    files: int
    tasks: int
    open: int
    stored: int


class Target:
    """Runs the rover, and watches that it moves by command only."""

    def __init__(self, options: Options, settings: Settings) -> None:
        logging.root.setLevel(logging.ERROR)
        self._errors = Lines("", logging.ERROR)
        self._held = options.held
        self._link = MrsLink(settings, port=0, terms=TransportSettings(options.encoding))
        self._lockstep = LockStep(
            settings, World(), options.folder, downlinks=(self._link,), picture=PICTURE
        )
        files = options.folder / "files"
        files.mkdir(parents=True, exist_ok=True)
        (files / FILE).write_bytes(bytes(FILE_OCTETS))
        if options.held:
            self._lockstep.rover.inject(OdometryLost())
        self._begun = self._lockstep.rover.true_pose
        self._tick_s = settings.tick_s
        self._moved = 0
        self._admitted: set[tuple[str, int]] = set()
        self._wake = threading.Event()
        self._lockstep.executive.wake = self._wake.set
        self._next_s = time.monotonic()
        self.uri = str(self._link.start(self._lockstep.executive))

    def turn(self) -> None:
        """Wait for a command or for the next tick, and serve it."""
        self._wake.wait(max(0.0, self._next_s - time.monotonic()))
        self._wake.clear()
        self._lockstep.executive.serve_inbox()
        self._watch()
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + _TURN_S
            self._lockstep.run(self._tick_s)
            self._watch()

    def poll(self) -> Sample:
        gc.collect()
        living = gc.get_objects()
        connections = [each for each in living if type(each) is Connection]
        tasks = [each for each in living if type(each) is asyncio.Task and not each.done()]
        return Sample(
            self._moved,
            frozenset(self._admitted),
            tuple(self._errors.lines[:_MAX_ERRORS]),
            len(self._errors.lines),
            resident_mb(),
            psutil.Process().num_fds(),
            len(tasks),
            sum(connection.is_open for connection in connections),
            len(connections),
        )

    def close(self) -> None:
        self._link.close()
        self._lockstep.executive.close()

    def _watch(self) -> None:
        executive, received = self._lockstep.executive, self._lockstep.downlink_record
        commanded = not self._held and executive.moving
        here = self._lockstep.rover.true_pose
        distance_m = hypot(here.x_m - self._begun.x_m, here.y_m - self._begun.y_m)
        displaced = self._held and distance_m > STILL_M
        self._moved += (executive.velocity != STANDING and not commanded) or displaced
        self._admitted |= {
            (report.identity.source, report.identity.command_id)
            for report in received.reports
            if report.identity is not None and report.stage is Stage.ACCEPTED
        }
        for stored in (received.reports, received.telemetry_batches, received.file_events):
            stored.clear()


def serve(options: Options, settings: Settings, pipe: Pipe) -> None:
    """Be the process: say the URI, then answer each request by a look, until left alone."""
    options.prepare()
    target = Target(options, settings)
    pipe.send(target.uri)
    with suppress(EOFError):
        while True:
            target.turn()
            if pipe.poll():
                pipe.recv()
                pipe.send(target.poll())
    target.close()
