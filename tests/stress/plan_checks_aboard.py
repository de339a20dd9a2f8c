"""Ticks of an executive in real time while it has plans proved, and while it has none.

Both alternate, so that other load of the machine is alike for both. The rover's checks run in a
process of the lowest priority: a tick waits for it until the scheduler's next interrupt, 1 to 4 ms.
"""

import asyncio
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import PlanCheckLevel, PlanVerdict
from tests.mrs.aboard import Aboard
from tests.mrs.test_plan_checks import WIDE
from tests.support.figures import quantile

ROUNDS = 15
ROUND_S = 2.0
TICK_S = 0.05
SHARE = 0.02
"""Share of the ticks by which late ones may be more: chosen."""


class Proofs:
    """Requests proofs of a plan with more states than are explored, one after the other.

    Attributes:
        ended: number of proofs that ended.
    """

    def __init__(self, uri: str) -> None:
        self.ended = 0
        self._uri = uri

    @contextmanager
    def running(self) -> Iterator[None]:
        """Request proofs for the time of a with; the last one is ended with its client."""
        loop = asyncio.new_event_loop()
        task = loop.create_task(self._request())
        thread = threading.Thread(target=lambda: loop.run_until_complete(asyncio.wait([task])))
        thread.start()
        try:
            yield
        finally:
            loop.call_soon_threadsafe(task.cancel)
            thread.join()
            loop.close()

    async def _request(self) -> None:
        async with await MrsClient.connect(self._uri) as client:
            while True:
                check = await client.check_plan(WIDE, PlanCheckLevel.PROVE)
                assert check.verdict is PlanVerdict.NO_FAULT_FOUND
                self.ended += 1


def lateness_s(aboard: Aboard) -> list[float]:
    """Return how late each tick of a round ended after it was due, in order of size."""
    late, due_s = [], time.monotonic()
    for _ in range(round(ROUND_S / TICK_S)):
        due_s += TICK_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        aboard.do(lambda bench: bench.step())
        late.append(time.monotonic() - due_s)
    return sorted(late)


def test_proofs_aboard_do_not_delay_ticks(tmp_path: Path) -> None:
    aboard = Aboard(tmp_path)
    proofs = Proofs(aboard.uri)
    without: list[float] = []
    during: list[float] = []
    for _ in range(ROUNDS):
        without += lateness_s(aboard)
        with proofs.running():
            during += lateness_s(aboard)
    aboard.close()
    for name, late in (("without", without), ("during proofs", during)):
        shares = ", ".join(f"{1e3 * quantile(late, q):.1f}" for q in (0.5, 0.95, 0.99))
        count = sum(each > TICK_S for each in late)
        print(f"{name}: {len(late)} ticks, 50/95/99 % {shares} ms, {count} late by a tick")
    print(f"{proofs.ended} proofs ended")
    more = sum(each > TICK_S for each in during) - sum(each > TICK_S for each in without)
    assert more <= SHARE * len(during)
