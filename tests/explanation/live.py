"""A rover whose core stands in lock step, and that is asked over a socket by the MRS meanwhile."""

import asyncio
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import TypeVar

from adapters.mrs.ground import MrsClient
from adapters.mrs.link import MrsLink
from adapters.recording import RunFile
from executive.core.recording import Item, RecordingTee
from executive.core.runner import Executive
from executive.history.history_builder import HistoryBuilder
from executive.values.ports import Downlink
from tests.explanation.case import Case
from tests.support.kinematic import Bench
from tests.support.sensed_drive import SensedRover
from trees import leaf_paths

T = TypeVar("T")

ANSWER_S = 60.0


class Recorder:
    """A tape that ends when somebody asks: what that brings about is no part of the run."""

    def __init__(self, path: Path) -> None:
        self.file = RunFile(path)
        self.ended = False

    def put(self, item: Item) -> None:
        if not self.ended:
            self.file.put(item)

    def end(self) -> None:
        self.ended = True
        self.file.close()


class LiveBench(Bench):
    """A bench that is recorded, and served by the MRS.

    Attributes:
        uri: where it is served.
        stored: how much of each kind is remembered.
        starts: how often an executive was started; what is not in its ledger is lost with one.
    """

    def __init__(self, folder: Path, case: Case, stored: int = 1000) -> None:
        self.stored = stored
        self.recorder = Recorder(folder / "run.mcap")
        self.starts = 0
        self._links: list[MrsLink] = []
        rover = None if case.rover is None else case.rover(case.settings)
        super().__init__(
            folder,
            case.settings,
            case.build_tree,
            rover,
            tape=self.recorder,
            all_sensors=isinstance(rover, SensedRover),
        )

    def __exit__(self, *_: object) -> None:
        for link in self._links:
            link.close()
        super().__exit__()
        if not self.recorder.ended:
            self.recorder.end()

    def _start(self) -> Executive:
        self.starts += 1
        self._history = HistoryBuilder(leaf_paths, self.stored)
        self._links.append(MrsLink(self.settings, port=0, history=self._history))
        self.tape = RecordingTee(self.recorder, self._history)
        executive = super()._start()
        self.uri = str(self._links[-1].start(executive))
        return executive

    def downlinks(self) -> list[Downlink]:
        self._history.restore(self.ledger.reports(1, count=self.stored))
        return [self.received, self._links[-1]]

    def request(self, session: Callable[[MrsClient], Awaitable[T]]) -> T:
        """Hold a session from the ground, and serve what it asks on this thread."""

        async def hold() -> T:
            async with await MrsClient.connect(self.uri) as client:
                return await session(client)

        return self.serve(lambda: asyncio.run(hold()))

    def serve(self, work: Callable[[], T]) -> T:
        """Have something done on another thread, and serve what it asks on this one."""
        turns: SimpleQueue[bool] = SimpleQueue()
        self.executive.wake = lambda: turns.put(True)
        with ThreadPoolExecutor(1) as ground:
            answer = ground.submit(work)
            answer.add_done_callback(lambda _: turns.put(False))
            while turns.get(timeout=ANSWER_S):
                self.executive.serve_inbox()
        return answer.result()
