"""`PlanCheckService` serves `Plan.checkPlan`: each check runs in a process of its own."""

import asyncio
import os
import pickle
import signal
import sys
from contextlib import nullcontext, suppress
from tempfile import TemporaryDirectory

from adapters.mal import CallContext
from adapters.mrs import spec as wire
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.plan_checks import START, CheckRequest, check_from
from adapters.mrs.spec import CHECK_LIMIT_S, DRAWS, MAX_DRAWS, AreaError, PlanCheckLevel, with_text
from executive.settings import Settings


class PlanCheckService:
    """Checks plans by the settings of an asset, one at a time.

    The process has the lowest priority, and limits of time and memory: see `adapters.mrs.
    plan_checks`. It is killed when its client is lost, when it exceeds its time, and when the link
    ends; if the executive is killed, it ends by itself. The core's thread is not involved.

    Args:
        served: its operations.
        settings: settings of the asset.
        limit_s: maximum time of a check by its level, s.
    """

    def __init__(
        self,
        served: ServedOperations,
        settings: Settings,
        limit_s: dict[PlanCheckLevel, float] = CHECK_LIMIT_S,
    ) -> None:
        self._settings = settings
        self._limit_s = limit_s
        self._is_busy = False
        served.serve("Plan", "checkPlan", self._check)

    async def _check(
        self,
        _: CallContext,
        plan: wire.PlanDefinition,
        level: PlanCheckLevel,
        draws: int | None,
        begin_ns: int | None,
    ) -> tuple[wire.PlanCheck]:
        if draws is not None and not (level is PlanCheckLevel.TRY and 1 <= draws <= MAX_DRAWS):
            text = f"draws: 1 to {MAX_DRAWS}, with TRY alone"
            raise with_text(AreaError.INVALID, text)
        if self._is_busy:
            raise with_text(AreaError.BUSY, "another plan is being checked: try again")
        begin_utc_s = None if begin_ns is None else begin_ns / 1e9
        definition = wire.definition_of(plan)
        request = CheckRequest(level, definition, self._settings, draws or DRAWS, begin_utc_s)
        self._is_busy = True
        try:
            with _files() if level is PlanCheckLevel.TRY else nullcontext() as folder:
                return (await self._run(request, folder),)
        finally:
            self._is_busy = False

    async def _run(self, request: CheckRequest, folder: str | None) -> wire.PlanCheck:
        """Return the answer of a new process with its files in a folder; it has ended then."""
        limit_s = self._limit_s[request.level]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-c", START),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=environment if folder is None else {**environment, "TMPDIR": folder},
            process_group=0,
        )
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            async with asyncio.timeout(limit_s):
                process.stdin.write(pickle.dumps(request))
                octets = await process.stdout.read()
                status = await process.wait()
        except TimeoutError:
            text = f"the check exceeded {limit_s:g} s: check the plan on the ground"
            raise with_text(AreaError.BUSY, text) from None
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.stdin.close()
            ended = asyncio.gather(process.stdout.read(), process.wait())
            while not ended.done():  # at once; the end of the link may cancel this again
                with suppress(asyncio.CancelledError):
                    await asyncio.wait({ended})
        return check_from(octets, status)


def _files() -> TemporaryDirectory[str]:
    """Return a folder for simulated runs: a killed process does not remove its files.

    Raises:
        MalError: NotSupported, the file system is read-only or full.
    """
    try:
        return TemporaryDirectory(prefix="rover-check-", ignore_cleanup_errors=True)
    except OSError as error:
        text = f"simulated runs need a temporary folder (TMPDIR): {error}"
        raise with_text(AreaError.NOT_SUPPORTED, text) from error
