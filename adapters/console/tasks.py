"""`start_task` starts an asyncio task of the console; if it ends with an exception, logs it."""

import asyncio
import logging
from collections.abc import Coroutine, Iterable
from typing import Any, Final

_LOG: Final = logging.getLogger(__name__)

CANCEL_POLL_S: Final = 0.5


def start_task(work: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
    """Start a task. The caller must hold the returned reference."""
    task = asyncio.create_task(work)
    task.add_done_callback(_log_fault)
    return task


async def cancel_tasks(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks in their order and wait until they have ended.

    Cancellation is repeated: before Python 3.13 a TaskGroup that fails at that moment loses a
    cancellation, as `asyncio.wait_for` does before 3.12.
    """
    left = list(tasks)
    while left:
        for task in left:
            task.cancel()
        await asyncio.wait(left, timeout=CANCEL_POLL_S)
        left = [task for task in left if not task.done()]


def _log_fault(task: asyncio.Task[None]) -> None:
    if not task.cancelled() and (fault := task.exception()) is not None:
        _LOG.error("a part of the console ended: %s", task.get_coro(), exc_info=fault)
