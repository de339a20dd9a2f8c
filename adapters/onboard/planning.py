"""`BackgroundSolver`: solves trajectories on a separate thread, for model predictive control."""

import logging
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from time import sleep
from typing import Final

from executive.motion import SharedSolver, Trajectory, TrajectoryProblem, make_solver
from executive.settings import Settings

PAUSE_S: Final = 0.0005
"""Pause between slices of a search, for the core's thread; chosen, not measured."""
_LOG = logging.getLogger(__name__)


class BackgroundSolver:
    """Solves problems on a thread of its own, one at a time; the result is for the next tick.

    casadi releases Python's interpreter lock while it solves.

    Args:
        thread: executes it; a new one unless given.
    """

    lead_ticks = 1

    def __init__(self, solver: SharedSolver, thread: ThreadPoolExecutor | None = None) -> None:
        self._solver = solver
        self._thread = thread or ThreadPoolExecutor(1, "planning")
        self._answer: Future[Trajectory | None] | None = None

    @property
    def busy(self) -> bool:
        """Whether it is solving a problem, and accepts no other."""
        return self._answer is not None and not self._answer.done()

    def request(self, problem: TrajectoryProblem) -> None:
        """Start to solve a problem; an earlier result that was not read is dropped."""
        self._answer = self._thread.submit(self._solve, problem)

    def take_result(self) -> Trajectory | None:
        """Return the result of the last problem, once; None if there is none, or none yet."""
        if self._answer is None or self.busy:
            return None
        answer, self._answer = self._answer, None
        return answer.result()

    def fork(self, apart: bool = False) -> "BackgroundSolver":
        """Return a second solver on the same thread, in turn with this one."""
        return BackgroundSolver(self._solver.fork(apart), self._thread)

    def close(self) -> None:
        """End the thread, after the present problem."""
        self._thread.shutdown()

    def _solve(self, problem: TrajectoryProblem) -> Trajectory | None:
        try:
            self._solver.request(problem)
            return self._solver.take_result()
        except Exception:
            _LOG.exception("no plan: the solver raised")
            return None


@contextmanager
def planning(settings: Settings) -> Iterator[SharedSolver | None]:
    """Yield the real-time solver of an asset; None if it needs no plans.

    Raises:
        SettingsError: casadi is not installed.
    """
    if not settings.offers_mpc:
        yield None
        return
    programmes = make_solver(settings)
    programmes.pause = partial(sleep, PAUSE_S)
    solver = BackgroundSolver(programmes)
    try:
        yield solver
    finally:
        solver.close()
