"""Tests at real time on a machine that stands still: what failed during that is played once more.

A lease, a heartbeat or a lifetime rightly ends while nothing gets a processor, and a test that
needs it cannot pass then. A test that fails without a stall fails.
"""

import os
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import Final

import pytest
from _pytest.runner import runtestprotocol

STALL_S: Final = 0.3
"""The shortest of what is kept alive lasts 0.5 s, and is renewed five times in that."""
PERIOD_S: Final = 0.05


class StallWatch:
    """Measures, while it is entered, for how long at most a thread that was due did not go on.

    Each processor has a thread, since a virtual machine may lose one of them for a while; another
    waits for the disk.

    Attributes:
        max_s: the longest such time so far.
    """

    def __init__(self) -> None:
        self.max_s = 0.0
        self._ended = threading.Event()
        watches: list[Callable[[], None]] = [self._watch_disk]
        watches += [partial(self._watch_processor, cpu) for cpu in os.sched_getaffinity(0)]
        self._threads = [
            threading.Thread(target=watch, name="stall watch", daemon=True) for watch in watches
        ]

    @property
    def stalled(self) -> bool:
        """Whether the machine stood still for long enough to excuse a failure."""
        return self.max_s > STALL_S

    def __enter__(self) -> "StallWatch":
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        for thread in self._threads:
            thread.join()

    def _watch_processor(self, cpu: int) -> None:
        os.sched_setaffinity(0, {cpu})  # of this thread
        self._watch(lambda: None)

    def _watch_disk(self) -> None:
        with tempfile.TemporaryFile() as file:

            def write() -> None:
                os.pwrite(file.fileno(), b"x", 0)
                os.fdatasync(file.fileno())

            self._watch(write)

    def _watch(self, work: Callable[[], None]) -> None:
        ended, before_s = False, time.monotonic()
        while not ended:
            ended = self._ended.wait(PERIOD_S)
            work()
            now_s = time.monotonic()
            self.max_s = max(self.max_s, now_s - before_s - PERIOD_S)
            before_s = now_s


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Play a test of real processes once more where it failed and the machine stalled."""
    if item.get_closest_marker("ros") is None or not isinstance(item, pytest.Function):
        return None
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    with StallWatch() as watch:
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
    failed = [report for report in reports if report.failed]
    if failed and watch.stalled:
        item._initrequest()
        reports = runtestprotocol(item, log=False, nextitem=nextitem)
        first = f"the machine stood still for {watch.max_s:.2f} s\n{failed[0].longreprtext}"
        reports[-1].sections.append(("the first time", first))
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
