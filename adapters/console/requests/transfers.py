"""`Transfers` fetches files from assets; each resumes at its interruption, also after a kill.

Received parts are in the store's folder for unfinished files, with the list of the transfers. The
list is written at each change of a state.
"""

import asyncio
import json
import logging
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum, unique
from typing import Final, assert_never

from adapters.console.messages import Transfer, TransferState, decode_transfer, plain
from adapters.console.requests.file_store import FileStore
from adapters.console.tasks import cancel_tasks, start_task
from adapters.console.web import RequestError
from adapters.mal import MalError
from adapters.mrs.ground import MrsClient, TransferError
from adapters.mrs.spec import AreaError, describe_error
from adapters.system import System

_LOG: Final = logging.getLogger(__name__)

MAX_ACTIVE: Final = 3
"""Maximum number of concurrent transfers; others are queued."""
MAX_CORRUPT: Final = 3
"""Attempts with a received file that differs from the one aboard, before the transfer fails."""
MAX_LISTED: Final = 100
"""Maximum length of the list; beyond it, ended transfers are removed."""
RETRY_S: Final = 1.0
"""Retry interval of an interrupted transfer, s."""
PROGRESS_S: Final = 0.25
"""Minimum interval between two progress messages of a transfer, s."""
RATE_WINDOW: Final = 12
"""Number of progress messages over which the rate is averaged."""
_LIST: Final = "list.json"
_FOR_GOOD: Final = {error.value for error in AreaError} - {AreaError.BUSY.value}
"""Errors that another attempt would receive again."""
Connect = Callable[[str], MrsClient]
"""Returns the session for files of an asset; raises RequestError if there is none."""

_ENDED: Final = {TransferState.DONE, TransferState.FAILED, TransferState.REMOVED}


@unique
class TransferAction(Enum):
    """Action of an operator on a transfer."""

    PAUSE = "pause"
    RESUME = "resume"


def store_path(asset: str, path: str) -> str:
    """Return the path of an asset's file in the store."""
    return f"{asset}/{path}"


@dataclass(slots=True, eq=False)
class _ActiveTransfer:
    """A transfer and its task.

    Attributes:
        stopped: set unless it runs or is queued.
        recent: recent times of the loop's clock, with the octets received by then.
        corrupt_attempts: number of received files that differ from the one aboard.
    """

    transfer: Transfer
    stopped: asyncio.Event = field(default_factory=asyncio.Event)
    recent: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=RATE_WINDOW))
    task: asyncio.Task[None] | None = None
    corrupt_attempts: int = 0


class Transfers:
    """Fetches files from assets into the store.

    Args:
        client: returns the session with an asset.
        store: stores the files.
        notify: called with a transfer at each change.
        system: clock and random ids.
    """

    def __init__(
        self, client: Connect, store: FileStore, notify: Callable[[Transfer], None], system: System
    ) -> None:
        self._client, self._store, self._publish, self._system = client, store, notify, system
        self._list = store.staged / _LIST
        self._known: dict[str, _ActiveTransfer] = {}
        self._slots = asyncio.Semaphore(MAX_ACTIVE)

    @property
    def listed(self) -> tuple[Transfer, ...]:
        """The transfers, in the order of their requests."""
        return tuple(each.transfer for each in self._known.values())

    def start(self) -> None:
        """Resume the transfers of a former process."""
        try:
            listed = json.loads(self._list.read_bytes())
            found = [decode_transfer(each) for each in listed]
        except FileNotFoundError:
            return
        except (OSError, ValueError, TypeError, KeyError) as error:
            _LOG.warning("%s cannot be read and is ignored: %s", self._list, error)
            return
        for transfer in found:
            moving = self._known[transfer.id] = _ActiveTransfer(transfer)
            if transfer.state in _ENDED | {TransferState.PAUSED}:
                moving.stopped.set()
                self._publish(transfer)
            else:
                self._turn(moving, TransferState.INTERRUPTED, "rover-console was restarted")
                moving.task = start_task(self._run_transfer(moving))

    async def close(self) -> None:
        """Stop all transfers; received parts are kept for resumption."""
        await cancel_tasks(each.task for each in self._known.values() if each.task is not None)

    def fetch(self, asset: str, path: str, by: str) -> Transfer:
        """Start the transfer of a file, unless one has not ended; return its status.

        Raises:
            ValueError: the path is not permitted.
            OSError: the store cannot be written.
        """
        self._store.stage(store_path(asset, path))
        for known in list(self._known.values()):
            if (known.transfer.asset, known.transfer.path) == (asset, path):
                if known.transfer.state not in _ENDED:
                    return known.transfer
                self._forget(known)
        now_s = self._system.utc_s()
        name, state = self._system.random_octets(8).hex(), TransferState.WAITING
        moving = _ActiveTransfer(Transfer(name, asset, path, by, state, now_s, now_s))
        self._known[name] = moving
        self._turn(moving, state, "")
        moving.task = start_task(self._run_transfer(moving))
        return moving.transfer

    async def until_stopped(self, name: str) -> Transfer:
        """Wait until a transfer has ended or is interrupted; return its status."""
        moving = self._known[name]
        await moving.stopped.wait()
        return moving.transfer

    async def apply(self, name: str, act: TransferAction) -> Transfer:
        """Pause a transfer that has not ended, or resume a paused one; return its status.

        Raises:
            KeyError: the id is unknown.
        """
        moving = self._known[name]
        paused = moving.transfer.state is TransferState.PAUSED
        match act:
            case TransferAction.PAUSE if not paused and moving.transfer.state not in _ENDED:
                await _cancel(moving)
                self._turn(moving, TransferState.PAUSED, "")
            case TransferAction.RESUME if paused:
                self._turn(moving, TransferState.WAITING, "")
                moving.task = start_task(self._run_transfer(moving))
            case TransferAction.PAUSE | TransferAction.RESUME:
                pass
            case _:
                assert_never(act)
        return moving.transfer

    async def remove(self, name: str) -> None:
        """End a transfer and remove it from the list; a stored file is not deleted.

        Raises:
            KeyError: the id is unknown.
        """
        moving = self._known[name]
        await _cancel(moving)
        self._store.discard(store_path(moving.transfer.asset, moving.transfer.path))
        self._forget(moving)
        self._write()

    async def _run_transfer(self, moving: _ActiveTransfer) -> None:
        """Fetch a file; retry until it is stored or the transfer fails."""
        while moving.transfer.state not in _ENDED:
            try:
                client = self._client(moving.transfer.asset)
                if self._slots.locked():
                    self._turn(moving, TransferState.WAITING, "queued behind other transfers")
                async with self._slots:
                    await self._attempt_transfer(client, moving)
                self._turn(moving, TransferState.DONE, "")
            except TransferError as error:  # for example changed aboard: it restarts
                moving.corrupt_attempts += 1
                is_retried = moving.corrupt_attempts < MAX_CORRUPT
                state = TransferState.INTERRUPTED if is_retried else TransferState.FAILED
                self._turn(moving, state, str(error))
            except (RequestError, MalError, OSError) as error:
                self._turn(moving, *_outcome(error))
            if moving.transfer.state is TransferState.INTERRUPTED:
                await asyncio.sleep(RETRY_S)

    async def _attempt_transfer(self, client: MrsClient, moving: _ActiveTransfer) -> None:
        path = moving.transfer.path
        target = store_path(moving.transfer.asset, path)
        moving.recent.clear()

        def on_progress(done: int, size: int) -> None:
            if moving.transfer.state is not TransferState.RUNNING:
                moving.transfer = replace(moving.transfer, done=done, size=size)
                self._turn(moving, TransferState.RUNNING, "")
            self._on_received(moving, done, size)

        file = await client.retrieve_file(path, self._store.stage(target), on_progress)
        moving.transfer = replace(moving.transfer, done=file.size, size=file.size)
        await asyncio.to_thread(self._store.add, target, file)

    def _on_received(self, moving: _ActiveTransfer, done: int, size: int) -> None:
        now_s = asyncio.get_running_loop().time()
        if moving.recent and now_s - moving.recent[-1][0] < PROGRESS_S:
            return
        moving.recent.append((now_s, done))
        (first_s, before), rate = moving.recent[0], None
        if now_s > first_s:
            rate = (done - before) / (now_s - first_s)
        utc_s = self._system.utc_s()
        moving.transfer = replace(moving.transfer, done=done, size=size, rate=rate, utc=utc_s)
        self._publish(moving.transfer)

    def _turn(self, moving: _ActiveTransfer, state: TransferState, detail: str) -> None:
        """Set the state of a transfer, and publish it if it has changed."""
        before, utc_s = moving.transfer, self._system.utc_s()
        moving.transfer = replace(before, state=state, detail=detail, rate=None, utc=utc_s)
        if state in {TransferState.WAITING, TransferState.RUNNING}:
            moving.stopped.clear()
        else:
            moving.stopped.set()
        if (before.state, before.detail) != (state, detail) or before.created == before.utc:
            self._publish(moving.transfer)
            self._write()

    def _forget(self, moving: _ActiveTransfer) -> None:
        del self._known[moving.transfer.id]
        moving.transfer = replace(moving.transfer, state=TransferState.REMOVED)
        moving.stopped.set()
        self._publish(moving.transfer)

    def _write(self) -> None:
        """Write the list atomically, without the earliest ended transfers beyond `MAX_LISTED`."""
        ended = [each for each in self._known.values() if each.transfer.state in _ENDED]
        for moving in ended[: max(0, len(self._known) - MAX_LISTED)]:
            self._forget(moving)
        part = self._list.with_suffix(".part")
        try:
            self._list.parent.mkdir(parents=True, exist_ok=True)
            part.write_text(json.dumps(plain(self.listed)), encoding="utf-8")
            part.replace(self._list)
        except OSError as error:
            _LOG.error("%s cannot be written: %s", self._list, error)


async def _cancel(moving: _ActiveTransfer) -> None:
    if moving.task is not None:
        await cancel_tasks((moving.task,))


def _outcome(error: Exception) -> tuple[TransferState, str]:
    """Return the state of a transfer after an error, with a human-readable reason."""
    match error:
        case MalError() if error.number in _FOR_GOOD:
            return TransferState.FAILED, describe_error(error)
        case MalError():
            return TransferState.INTERRUPTED, describe_error(error)
        case RequestError() | ConnectionError():
            return TransferState.INTERRUPTED, str(error)
        case _:
            return TransferState.FAILED, f"the file cannot be stored: {error}"
