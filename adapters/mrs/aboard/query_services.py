"""Services that query the core: command authority, history, behaviour tree, previews."""

import asyncio
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

from adapters.explanation import select_for
from adapters.mal import CallContext, MalError
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import CoreGateway, Reply
from adapters.mrs.aboard.served_operations import PeerRateLimiter, ServedOperations
from adapters.mrs.spec import (
    AreaError,
    AuthorityStatus,
    PreviewRequest,
    framed,
    motion_of,
    refusal_error,
    refusal_text,
    wire_history,
    wire_plan_preview,
    wire_preview,
    with_text,
)
from adapters.mrs.spec.tree_updates import change_update, whole_update
from executive.commands import Motion, PlanDefinition, request_text
from executive.core.authority import AuthorityAction, AuthorityRequest, AuthorityState
from executive.core.runner import Executive
from executive.history import ReceivedCommand, RunHistory
from executive.history.history_builder import HistoryBuilder
from executive.preview import Preview, PreviewRun, StepPreview
from executive.settings import Settings
from executive.values.facts import PlannedPath
from executive.values.ports import PLANNER_WAIT_S, PathRequest
from executive.values.reasons import Refusal
from executive.values.reports import Identity, Report, without_figures
from trees import TreeSnapshot, snapshot_of

SLICE_TICKS: Final = 2
PAUSE_S: Final = 0.0005
MAX_CONCURRENT: Final = 2
PLANNER_POLL_S: Final = 0.05
_NO_ANSWER: Final = "no path of the planner in time"
MAX_PREVIEW_S: Final = 60.0
"""Timeout of a preview, e.g. if the trajectory solver does not answer; chosen, not measured."""


class PreviewService:
    """Serves `MotionControl.preview` and those of `Plan`, `MAX_CONCURRENT` at a time.

    They are computed in slices on the link's loop. A slice holds Python's interpreter lock for a
    millisecond or two, and the loop sleeps after it. So the core's thread meets its ticks, and a
    stop is served during a preview.
    """

    def __init__(self, served: ServedOperations, gateway: CoreGateway) -> None:
        self._gateway = gateway
        self._running = 0
        served.serve("MotionControl", "preview", self._motion)
        served.serve("Plan", "previewPlan", self._preview_plan)
        served.serve("Plan", "previewSteps", self._preview_steps)

    async def _motion(
        self,
        call: CallContext,
        operation: str,
        waypoints: tuple[wire.Waypoint, ...] | None,
        figures: tuple[float, ...] | None,
        controller: wire.Controller | None,
    ) -> tuple[wire.Preview]:
        request = PreviewRequest(operation, waypoints, figures, controller)
        return (await self._work_out(framed(motion_of(request), call.supplements)),)

    async def _preview_plan(self, _: CallContext, plan: wire.PlanDefinition) -> tuple[wire.Preview]:
        return (await self._work_out(wire.definition_of(plan)),)

    async def _preview_steps(
        self, _: CallContext, plan: wire.PlanDefinition
    ) -> tuple[wire.PlanPreview]:
        result, steps = await self._run(wire.definition_of(plan))
        if isinstance(result, Refusal) and _error_of(result) is AreaError.INVALID and not steps:
            raise _refusal_error(result)
        return (wire_plan_preview(result, steps),)

    async def _work_out(self, request: Motion | PlanDefinition) -> wire.Preview:
        result, _ = await self._run(request)
        if isinstance(result, Refusal):
            raise _refusal_error(result)
        return wire_preview(result)

    async def _run(
        self, request: Motion | PlanDefinition
    ) -> tuple[Preview | Refusal, Sequence[StepPreview]]:
        if self._running >= MAX_CONCURRENT:
            raise with_text(AreaError.BUSY, f"{MAX_CONCURRENT} previews are running: try again")
        self._running += 1
        try:
            run = await self._gateway.query(lambda executive: executive.preview(request))
            if isinstance(run, Refusal):
                return run, ()
            return await self._run_in_slices(run), run.steps
        finally:
            self._running -= 1

    async def _run_in_slices(self, run: PreviewRun) -> Preview | Refusal:
        run.set_up()
        silent: PlannedPath | None = None
        try:
            async with asyncio.timeout(MAX_PREVIEW_S):
                while run.result is None:
                    await asyncio.sleep(PAUSE_S)
                    run.advance(SLICE_TICKS)
                    if run.path_request is not None:
                        path = silent or await self._planned(run.path_request)
                        silent = path if path.text == _NO_ANSWER else None
                        run.provide_path(path)
        except TimeoutError:
            text = f"the preview was not computed within {MAX_PREVIEW_S:g} s: preview it in parts"
            raise with_text(AreaError.BUSY, text) from None
        return run.result

    async def _planned(self, wanted: PathRequest) -> PlannedPath:
        """Return the answer of the navigation's planner; without points there is no path."""
        query = self._gateway.query
        request = await query(lambda executive: executive.predictions.request_path(wanted))
        if request is None:
            return PlannedPath(wanted.number, (), "the planner is not available during a drive")
        loop = asyncio.get_running_loop()
        until_s = loop.time() + PLANNER_WAIT_S
        while loop.time() < until_s:
            await asyncio.sleep(PLANNER_POLL_S)
            path = await query(lambda executive: executive.status.planned_path(request.number))
            if path is not None:
                return path
        return PlannedPath(wanted.number, (), _NO_ANSWER)


def _refusal_error(refusal: Refusal) -> MalError:
    """Return the error for a refusal, with its full text: no report follows."""
    return with_text(_error_of(refusal), refusal_text(refusal))


def _error_of(refusal: Refusal) -> AreaError:
    return _ERRORS.get(refusal.reason.value // 100, AreaError.REJECTED)


_ERRORS: Final = {1: AreaError.INVALID, 4: AreaError.NOT_SUPPORTED}
"""Errors by block of the reason number; Rejected for all other blocks."""


Result = AuthorityState | Refusal
Act = Callable[[Executive, Callable[[Result], None]], None]

REQUESTS_HZ: Final = 10
"""Maximum requests a second of one peer: each change of holder is stored and broadcast."""


def serve_authority(served: ServedOperations, gateway: CoreGateway) -> None:
    """Serve the authority of an executive; all operations but getAuthority name the requester."""
    rate = PeerRateLimiter(REQUESTS_HZ, asyncio.get_running_loop().time)

    def serve(operation: str, act: Callable[..., Act]) -> None:
        def handler(call: CallContext, *parts: Any) -> Any:
            if parts:
                rate.admit(call.peer_name or call.connection.peer_host)
                _require_name(parts[0], call.peer_name)

            def question(executive: Executive, reply: Reply[tuple[AuthorityStatus]]) -> None:
                act(*parts)(
                    executive, lambda result: reply(lambda: (_status(result, call.peer_name),))
                )

            answer = gateway.query_later(question)
            if parts:
                served.prioritize(
                    call.connection, answer, lambda reply: reply[0].holder == parts[0]
                )
            return answer

        served.serve("Authority", operation, handler)

    serve("getAuthority", lambda: lambda executive, reply: reply(executive.authority.state))
    serve("requestAuthority", partial(_authority_query, AuthorityAction.REQUEST))
    serve("handOver", partial(_authority_query, AuthorityAction.HAND_OVER))
    serve("takeAuthority", partial(_authority_query, AuthorityAction.TAKE))
    serve("releaseAuthority", partial(_authority_query, AuthorityAction.RELEASE))


def _authority_query(act: AuthorityAction, *parts: Any) -> Act:
    request = AuthorityRequest(act, *parts)
    return lambda executive, reply: executive.request_authority(request, reply)


def _require_name(source: str, peer_name: str | None) -> None:
    if peer_name not in {None, source}:
        raise with_text(AreaError.REJECTED, f"source {source}: the certificate names {peer_name}")


def _status(found: Result, caller: str | None) -> AuthorityStatus:
    if isinstance(found, Refusal):
        raise refusal_error(found, Identity("", 0))
    return AuthorityStatus(
        holder=found.holder,
        epoch=found.epoch,
        leaseLeft=found.lease_left_s,
        lease=found.lease_s,
        requestedBy=found.requested_by,
        needed=found.needed,
        caller=caller,
    )


MAX_REPORTS: Final = 1000
"""Maximum reports read from the ledger at once."""
REPORTS_AFTER_END: Final = 8
"""Reports after the end of a command, which include those of a stop that ended it."""


class HistoryService:
    """Serves `Notification.getHistory`.

    The core's thread, on which `history` runs, only copies references. A separate thread selects
    and encodes the answer, so that a stop is not delayed.
    """

    def __init__(
        self, served: ServedOperations, gateway: CoreGateway, history: HistoryBuilder
    ) -> None:
        self._gateway = gateway
        self._history = history
        served.serve("Notification", "getHistory", self._get)

    async def _get(
        self, _: CallContext, source: str | None, number: int | None, everything: bool
    ) -> tuple[wire.History]:
        known = await self._gateway.query(
            lambda executive: self._recorded_history(executive, number)
        )
        command = str(number) if source is None else f"{source}:{number}"
        wanted = None if number is None else command
        return (await asyncio.to_thread(_wire_history_of, known, wanted, everything),)

    def _recorded_history(self, executive: Executive, number: int | None) -> RunHistory:
        """Return the recorded history; for a command also its reports in the ledger."""
        history = self._history.history()
        if number is None:
            return history
        own = [each for each in executive.reports(1, number) if each.stage is not None]
        reports = {each.sequence: each for each in (*own, *history.reports)}
        first = history.reports[0].sequence if history.reports else executive.last_sequence
        if own and own[0].sequence < first:
            reported = own[-1].sequence - own[0].sequence + 1
            stored = executive.reports(
                own[0].sequence, count=min(reported + REPORTS_AFTER_END, MAX_REPORTS)
            )
            reports |= {each.sequence: each for each in stored}
        received = {each.identity for each in history.received}
        return replace(
            history,
            reports=tuple(reports[each] for each in sorted(reports)),
            received=(*_received_before(executive, own, received), *history.received),
        )


def _received_before(
    executive: Executive, reports: Sequence[Report], known: Container[Identity]
) -> Iterator[ReceivedCommand]:
    """Yield the commands of reports that are not in `known`, as far as the ledger has them."""
    for each in {report.identity: report for report in reversed(reports)}.values():
        if each.identity is None or each.identity in known or each.link is None:
            continue
        request = executive.request_of(each.identity)
        if request is not None:
            name, text = type(request).__name__, request_text(request)
            yield ReceivedCommand(each.identity, text, name, each.link, each.utc_s)


def _wire_history_of(known: RunHistory, command: str | None, everything: bool) -> wire.History:
    if everything:
        return wire_history(replace(known, leaves=(), fastest=()))
    return wire_history(select_for(known, command))


POLL_S: Final = 0.2
FIGURES_ONLY_S: Final = 1.0
"""Minimum period of updates in which only figures of texts differ; nothing else depends on it."""
FULL_UPDATE_S: Final = 10.0


@dataclass(frozen=True, slots=True)
class _LastBroadcast:
    """A snapshot that was broadcast, with its time by the loop's clock."""

    snapshot: TreeSnapshot
    at_s: float


class TreeService:
    """Broadcasts the behaviour tree by `Status.monitorTree` while it has subscribers.

    The core's thread returns a snapshot at each poll; the link's loop decides which update is sent,
    and when. Without subscribers the core is not polled.
    """

    def __init__(self, served: ServedOperations, gateway: CoreGateway, settings: Settings) -> None:
        self._gateway = gateway
        self._asset = settings.asset
        self._domain = settings.domain
        self._publisher = served.publisher("Status", "monitorTree", self._begin)
        self._publishing: asyncio.Task[None] | None = None
        self._number = 0
        self._whole: _LastBroadcast | None = None
        self._last: _LastBroadcast | None = None

    def _begin(self) -> None:
        """Send a full tree to the new subscriber."""
        self._whole = None
        if self._publishing is None or self._publishing.done():
            self._publishing = asyncio.create_task(self._broadcast())

    async def _broadcast(self) -> None:
        while self._publisher.has_subscribers:
            with suppress(MalError):  # the core is busy or hangs: skip this poll
                self._poll(await self._gateway.query(_snapshot))
            await asyncio.sleep(POLL_S)

    def _poll(self, snapshot: TreeSnapshot) -> None:
        """Broadcast the update that is due, if any."""
        now = _LastBroadcast(snapshot, asyncio.get_running_loop().time())
        whole, last, change = self._whole, self._last, None
        if whole is not None and last is not None and now.at_s - whole.at_s < FULL_UPDATE_S:
            if _same(last.snapshot, snapshot):
                return
            if now.at_s - last.at_s < FIGURES_ONLY_S and _same(
                _without_figures(last.snapshot), _without_figures(snapshot)
            ):
                return
            change = change_update(self._number, whole.snapshot, snapshot)
        if change is None:
            self._number += 1
            self._whole = now
        self._last = now
        self._publisher.publish(
            change or whole_update(self._number, snapshot),
            keys=(self._asset,),
            domain=self._domain,
            source=self._asset,
            droppable=True,
        )


def _snapshot(executive: Executive) -> TreeSnapshot:
    return snapshot_of(executive, executive.parameters()[0].utc_s)


def _same(one: TreeSnapshot, other: TreeSnapshot) -> bool:
    """Whether two snapshots are equal except for their times."""
    return replace(one, tick=other.tick, utc_s=other.utc_s) == other


def _without_figures(snapshot: TreeSnapshot) -> TreeSnapshot:
    """Return a snapshot without figures."""
    nodes = tuple(replace(each, message=without_figures(each.message)) for each in snapshot.nodes)
    return replace(snapshot, nodes=nodes, why=without_figures(snapshot.why))
