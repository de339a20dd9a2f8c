"""`Stops` sends the stops of operators, and repeats a stop until the asset has answered.

A stop needs no authority. It is sent over the direct link if that is up, otherwise over all
connected links: over a relay it may arrive much later, and would stop a rover that was resumed in
between. A repeated stop has the same id; before it is repeated, the asset is queried for that id: a
rover that received it and was resumed is not stopped again. The page repeats a stop until it has
reached the console; `MAX_AGE_S` counts from the press, and ends both.
"""

import asyncio
import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from http import HTTPStatus
from typing import Final

from adapters.console.command_states import CONSOLE, LIFECYCLE_STATES, ORBITER
from adapters.console.messages import CommandStatus, LinkKind, LinkState, StopState, StopStatus
from adapters.console.rovers import (
    FORMS,
    CommandTracker,
    ConnectedAsset,
    OperatorAuthority,
    RoverLink,
    sent_status,
)
from adapters.console.tasks import start_task
from adapters.console.web import refused
from adapters.mal import MalError
from adapters.mrs.ground import CommandIdGenerator, MrsClient
from adapters.mrs.spec import LINK, AreaError, describe_error
from executive.commands import Command, Family, Stop
from executive.values.reports import Identity

_LOG: Final = logging.getLogger(__name__)

STOP: Final = next(each.name for each in FORMS.values() if each.family is Family.STOP)
REPEAT_S: Final = 0.5
"""Interval between two attempts to send a stop, s."""
MAX_AGE_S: Final = 600.0
"""Maximum age of a stop without an answer, from the press, s; chosen, not measured."""
REFUSALS: Final = {error.value for error in AreaError} - {AreaError.DUPLICATE.value}


@dataclass(slots=True)
class _Pending:
    """A stop without an answer.

    Attributes:
        end_s: time of its expiry.
        delivery: the task that sends it.
        sent: whether the asset may have received it.
        stored: links to orbiters that have stored it.
    """

    status: StopStatus
    command: Command
    end_s: float
    delivery: asyncio.Task[None] | None = None
    sent: bool = False
    stored: set[RoverLink] = field(default_factory=set)


class Stops:
    """Sends stops.

    Args:
        tracker: tracks the states of commands.
        desk: sources of the operators.
        numbers: command ids.
        publish: sends the status of a stop to all pages.
        utc: clock, s since 1970 UTC.
    """

    def __init__(
        self,
        tracker: CommandTracker,
        desk: OperatorAuthority,
        numbers: CommandIdGenerator,
        publish: Callable[[StopStatus], None],
        utc: Callable[[], float],
    ) -> None:
        self._tracker, self._desk, self._numbers = tracker, desk, numbers
        self._publish, self._utc = publish, utc
        self._pending: dict[str, _Pending] = {}

    def send(self, operator: str, asset: ConnectedAsset, age_s: float = 0.0) -> CommandStatus:
        """Send a new stop; while the previous one was not sent yet, prolong that instead.

        Args:
            operator: operator that pressed STOP.
            asset: its asset.
            age_s: time between the press and its reception here, s.
        """
        name, now_s = asset.entry.asset, self._utc()
        end_s = now_s - age_s + MAX_AGE_S
        before = self._pending.get(name)
        if before is not None and (not before.sent or end_s <= now_s):
            before.end_s = max(before.end_s, end_s)
            known = self._tracker.get(before.status.command)
            assert known is not None, "a stop is tracked until it has ended"
            return known
        if before is not None:
            end_s = max(end_s, before.end_s)
            self._end(before, StopState.CALLED_OFF, "another stop replaces it")
        link = next((link for link, _ in _targets(asset)), next(iter(asset.links.values())))
        identity = Identity(self._desk.source(link, operator), self._numbers.next_id())
        command = Command(identity, Stop(), LINK, created_utc_s=now_s)
        _LOG.warning("%s stops %s: %s", operator, name, identity)
        # Not claimed first; other consoles derive the same id.
        status = sent_status(
            *(f"{name}:{identity}", name, operator, link.kind, command, {}),
            round_trip_s=link.delay.declared_s,
        )
        self._tracker.register(status)
        asset.predictor.on_sent(command, now_s)
        stop = StopStatus(name, status.id, operator, now_s - age_s, now_s, StopState.WAITING)
        pending = self._pending[name] = _Pending(stop, command, end_s)
        self._publish(stop)
        pending.delivery = start_task(self._deliver(asset, pending))
        return status

    def call_off(self, operator: str, asset: str) -> StopStatus:
        """End the repetition of a stop.

        Raises:
            RequestError: no stop of the asset waits for its answer.
        """
        pending = self._pending.get(asset)
        if pending is None:
            raise refused(HTTPStatus.NOT_FOUND, f"no stop of {asset[:64]} waits for its answer")
        return self._end(pending, StopState.CALLED_OFF, f"called off by {operator}")

    async def close(self) -> None:
        """Wait up to 1 s for answers, then end all repetitions."""
        waiting = [each.delivery for each in self._pending.values() if each.delivery is not None]
        if waiting:
            _, left = await asyncio.wait(waiting, timeout=1.0)
            for task in left:
                task.cancel()

    async def _deliver(self, asset: ConnectedAsset, pending: _Pending) -> None:
        attempts: dict[RoverLink, asyncio.Task[None]] = {}
        try:
            while self._utc() < pending.end_s:
                for link, client in _targets(asset):
                    idle = link not in attempts or attempts[link].done()
                    if idle and link not in pending.stored:
                        attempts[link] = start_task(self._attempt(link, client, pending))
                await asyncio.sleep(REPEAT_S)
                known = self._tracker.get(pending.status.command)
                if known is not None and known.state in LIFECYCLE_STATES:
                    self._end(pending, StopState.ANSWERED)
                    return
            self._end(pending, StopState.EXPIRED, f"expired after {MAX_AGE_S:g} s")
        finally:
            for task in attempts.values():
                task.cancel()

    async def _attempt(self, link: RoverLink, client: MrsClient, pending: _Pending) -> None:
        name, is_direct = pending.status.command, link.kind is LinkKind.DIRECT
        node = link.asset if is_direct else ORBITER
        try:
            if not (pending.sent and is_direct and await _knows(client, pending.command)):
                pending.sent = True
                await client.submit(pending.command)
        except MalError as error:
            if error.number in REFUSALS:
                self._tracker.on_rejected(name, node, describe_error(error))
                self._end(pending, StopState.REFUSED, describe_error(error))
                return
            if error.number != AreaError.DUPLICATE.value:
                self._tracker.mark_unknown(name, f"no valid answer: {describe_error(error)}")
                return
        except ConnectionError as error:
            self._tracker.mark_unknown(name, f"the link was lost before the answer: {error}")
            return
        self._tracker.on_acknowledged(name, node)
        if is_direct:
            self._end(pending, StopState.ANSWERED)
        else:
            pending.stored.add(link)

    def _end(self, pending: _Pending, state: StopState, detail: str = "") -> StopStatus:
        stop = replace(pending.status, state=state, utc=self._utc(), detail=detail)
        if self._pending.get(stop.asset) is not pending:
            return stop
        del self._pending[stop.asset]
        if state in {StopState.CALLED_OFF, StopState.EXPIRED}:
            _LOG.warning("%s: stop %s: %s", stop.asset, pending.command.identity, detail)
            if pending.sent:
                self._tracker.mark_unknown(stop.command, detail)
            else:
                self._tracker.on_rejected(stop.command, CONSOLE, f"{detail}: it was not sent")
        self._publish(stop)
        if pending.delivery is not None:
            pending.delivery.cancel()
        return stop


def _targets(asset: ConnectedAsset) -> Iterator[tuple[RoverLink, MrsClient]]:
    """Yield the links over which a stop is sent now, with their sessions."""
    direct = asset.links.get(LinkKind.DIRECT)
    is_up = direct is not None and direct.state is LinkState.UP
    for link in asset.links.values():
        if link.client is not None and (link is direct or not is_up):
            yield link, link.client


async def _knows(client: MrsClient, command: Command) -> bool:
    """Whether a rover has received a command."""
    try:
        await client.get_arguments(command.identity)
    except MalError:
        return False
    return True
