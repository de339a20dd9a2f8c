"""`MrsClient`: commands with their outcome, queries, and streams of a rover's updates."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from adapters.mal import MalError
from adapters.mrs import spec as wire
from adapters.mrs.ground.file_retrieval import FileNotification, FileRetrieval
from adapters.mrs.ground.outcome import CommandOutcome, CommandWatch, OnReport, describe_storage
from adapters.mrs.ground.queries import LINK_LOST_ERRORS, Queries
from adapters.mrs.ground.rover_consumer import NotServedError, RoverConsumer
from adapters.mrs.ground.session import (
    LinkDelay,
    RoverSession,
    SessionAuthority,
    parse_address,
)
from adapters.mrs.ground.streams import NotificationStream, Stream, Streams, TreeUpdates, Updates
from adapters.mrs.spec import (
    LINK,
    LIST_PRECONDITIONS,
    AreaError,
    AuthorityStatus,
    FileInfo,
    Notification,
    ParameterValue,
    ReceivedReport,
    ReceivedValue,
    header_of,
    invocation,
    plan_update_of,
    received_value,
    supplements_of,
)
from adapters.mrs.transport import CLEAR, TransportSettings
from adapters.system import OPERATING_SYSTEM, System, utc_ns
from executive.commands import Command, Precondition, PreemptionPolicy, Request, Stop
from executive.values.reports import Identity, PlanUpdate

if TYPE_CHECKING:
    from trees import TreeSnapshot

T = TypeVar("T")

SOURCE: Final = "MOE"
"""Default source of commands."""
HEARTBEAT_S: Final = 1.0
"""Period of the heartbeat requests to the rover; chosen, not measured."""
STORED_AFTER_S: Final = 1.0
"""Time without a report after which a command counts as stored at an orbiter."""
REPORTS: Final = ("Notification", "monitorNotification")
"""Service and operation of the reports of commands."""
MAX_ATTEMPTS: Final = 8
"""Maximum transmissions of one command over new connections; chosen, not measured."""
EPOCH_MS: Final = 1_767_225_600_000
"""Epoch of command numbers: 2026-01-01, in ms since 1970 UTC."""


class CommandIdGenerator:
    """Generates command numbers: ms since 2026, or the last number plus 1; never 0, never twice.

    A restarted client continues above its former numbers, unless it used more than one a
    millisecond or the clock was set back.

    Args:
        system: the clock.
    """

    def __init__(self, system: System = OPERATING_SYSTEM) -> None:
        self._system = system
        self._last = 0

    def next_id(self) -> int:
        """Return a new number."""
        self._last = max(self._last + 1, utc_ns(self._system) // 1_000_000 - EPOCH_MS)
        return self._last


class MrsClient(Queries):
    """Session of one mission control with one rover, across losses of the link.

    After a loss it reconnects, subscribes again, and catches up with missed notifications. While
    connected it sends a heartbeat request once a second, so that the rover detects the contact
    even without commands; on a link with a delay also while answers are pending. All methods
    raise ConnectionError if the link does not recover in time, and MalError if the rover answers
    with an error.

    Attributes:
        authority: the authority that its commands claim, once requested.
        delay: declared and measured round-trip time of its link.
    """

    def __init__(
        self,
        uri: str,
        source: str,
        terms: TransportSettings,
        timeout_s: float,
        patience_s: float,
        system: System,
    ) -> None:
        """Use `connect` instead."""
        self.source = source
        self.authority = SessionAuthority(self._send_authority_request, source)
        address, ends = parse_address(uri), (self._restore, self._on_reconnect_failed)
        timeout_s += terms.round_trip_s
        patience_s += terms.round_trip_s if patience_s > 0.0 else 0.0
        session = RoverSession(address, source, terms, *ends, timeout_s, patience_s, system)
        super().__init__(session, terms.round_trip_s)
        self.delay = LinkDelay(terms.round_trip_s)
        self._system, self._numbers = system, CommandIdGenerator(system)
        self._watches: list[CommandWatch] = []
        self._notifications: Streams[ReceivedReport] = Streams()
        self._feed = NotificationStream(self._deliver, self._on_new_ledger)
        self._telemetry: Updates[ReceivedValue] = Updates(
            "Monitoring", "monitorValue", received_value
        )
        self._trees = TreeUpdates()
        self._file_events: Updates[FileNotification] = Updates(
            "FileManagement", "monitorFiles", FileNotification
        )
        self._plans: Updates[PlanUpdate] = Updates("Plan", "monitorPlanExecution", self._note_plan)
        self._last_of_plans: dict[str, PlanUpdate] = {}
        self._heartbeat_task: asyncio.Task[None] | None = None

    @classmethod
    async def connect(
        cls,
        to: str,
        source: str | None = None,
        timeout_s: float = 10.0,
        patience_s: float = 30.0,
        terms: TransportSettings = CLEAR,
        system: System = OPERATING_SYSTEM,
    ) -> "MrsClient":
        """Connect to a rover.

        Args:
            to: `maltcp://host:port/MRS`, `host:port` or `host`.
            source: source of its commands; None for the name of the certificate, MOE in clear
                text.
            timeout_s: timeout of each answer, beyond the declared round-trip time of the link.
            patience_s: maximum time of reconnection attempts after a loss, beyond the declared
                round-trip time; 0 for none.
            terms: encoding and certificates, the same as the rover's, and the link's delay.
            system: clock of messages.

        Raises:
            CertificateError: a certificate file cannot be used.
            ConnectionError: no rover answers there, or certificates are not trusted.
            ValueError: `to` is no address.
        """
        if source is None and terms.certificates is not None:
            source = terms.certificates.name()
        client = cls(to, source or SOURCE, terms, timeout_s, patience_s, system)
        await client._session.open()
        client._heartbeat_task = asyncio.create_task(client._send_heartbeats())
        return client

    async def __aenter__(self) -> "MrsClient":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the session; streams end."""
        self.authority.detach()
        if self._heartbeat_task is not None:
            self._heartbeat_task.cancel()
        await self._session.close()
        self._end(None, ConnectionError("the session was closed"))

    def authority_of(self, source: str) -> SessionAuthority:
        """Return the authority of another source, without periodic renewal.

        So several operators command over one session. With certificates the rover accepts only
        the name of the certificate.
        """
        return SessionAuthority(self._send_authority_request, source, renews=False)

    def command(
        self,
        request: Request,
        *,
        source: str | None = None,
        command_id: int | None = None,
        lifetime_s: float | None = None,
        preemption: PreemptionPolicy = PreemptionPolicy.APPEND,
        authority: int | None = None,
        precondition: Precondition | None = None,
    ) -> Command:
        """Return a new command, created now.

        Args:
            request: the request to command.
            source: its source; None for that of this session.
            command_id: its number; None for a new one.
            lifetime_s: maximum age at its start; None for no limit.
            preemption: its effect on active motion.
            authority: the epoch that it claims; None for that of this session.
            precondition: conditions of its execution; ignored for a stop.
        """
        number = self._numbers.next_id() if command_id is None else command_id
        return Command(
            identity=Identity(source or self.source, number),
            request=request,
            link=LINK,
            created_utc_s=self._system.utc_s(),
            lifetime_s=lifetime_s,
            preemption=preemption,
            authority=self.authority.epoch if authority is None else authority,
            precondition=None if isinstance(request, Stop) else precondition,
        )

    async def run(
        self,
        command: Command,
        on_report: OnReport = lambda _: None,
        on_stored: Callable[[str], None] | None = None,
    ) -> CommandOutcome:
        """Send a command and wait until it ends or is lost at a relay, across losses of the link.

        Args:
            command: a command, as returned by `command`.
            on_report: called with each report of its life cycle on reception.
            on_stored: called with a text on its storage, if it waits at an orbiter.

        Raises:
            ConnectionError: also an asset that accepts commands without reports of their ends.
        """
        watch = CommandWatch(command, on_report)
        self._watches.append(watch)
        checking: asyncio.Task[None] | None = None
        try:
            if not isinstance(command.request, Stop):
                (await self._session.consumer()).require(*REPORTS)
            await self.submit(command)
            checking = asyncio.create_task(self._check_reported(watch))
            if on_stored is not None:
                await self._report_if_stored(watch, on_stored)
            await watch.ended
            return watch.outcome
        except MalError as refusal:
            return replace(watch.outcome, refusal=refusal)
        finally:
            self._watches.remove(watch)
            if checking is not None:
                checking.cancel()

    async def _check_reported(self, watch: CommandWatch) -> None:
        """Check the directory, which may answer only after the command was sent."""
        with suppress(ConnectionError, MalError):  # they end the watch, or the link is restored
            consumer = await self._session.consumer()
            try:
                await consumer.wait_discovered()
                consumer.require(*REPORTS)
            except NotServedError as error:
                identity = watch.outcome.command.identity
                text = f"{identity} was accepted, but its end is not reported: {error}"
                watch.fail(ConnectionError(text))

    async def _report_if_stored(
        self, watch: CommandWatch, on_stored: Callable[[str], None]
    ) -> None:
        await asyncio.wait((watch.ended,), timeout=STORED_AFTER_S)
        if watch.has_reports:
            return
        where = await describe_storage(self.get_value)
        if where is not None and not watch.has_reports:
            on_stored(where)

    async def supports_preconditions(self) -> bool:
        """Whether the rover announces preconditions; needs no request of its own."""
        return await (await self._session.consumer()).lists(*LIST_PRECONDITIONS)

    async def submit(self, command: Command) -> None:
        """Send a command and return when the rover, or the orbiter before it, has accepted it.

        If the link is lost before the answer, it is resent: the rover executes it at most once.
        After `MAX_ATTEMPTS` losses the command itself is the likely cause: it is too long.
        A command with a precondition is sent only to an asset that announces support.
        """
        call = invocation(command.request)
        losses, was_sent = 0, False
        while losses < MAX_ATTEMPTS:
            consumer = await self._session.consumer()
            try:
                if command.precondition and not await self.supports_preconditions():
                    raise NotServedError(f"{self._session.uri} does not support preconditions")
                await consumer.submit(
                    call.service,
                    call.operation,
                    header_of(command),
                    *call.parts,
                    supplements=supplements_of(command),
                )
                return
            except MalError as error:
                if error.number == AreaError.DUPLICATE.value and was_sent:
                    return
                if error.number not in LINK_LOST_ERRORS:
                    raise
                was_sent = True
                losses += consumer.has_answered  # otherwise no rover received it
                await self._session.drop(consumer)
        raise ConnectionError(
            f"{self._session.uri} disconnected {MAX_ATTEMPTS} times at"
            f" {call.service}.{call.operation}:"
            " is the message longer than the rover accepts?"
        )

    def notifications(self) -> Stream[ReceivedReport]:
        """Return the rover's reports from now on."""
        return self._notifications.open()

    async def telemetry(self) -> Stream[ReceivedValue]:
        """Return parameter values from now on."""
        return await self._subscribe(self._telemetry)

    async def plan_updates(self) -> Stream[PlanUpdate]:
        """Return status updates of plans from now on; first all states after a loss of the link."""
        return await self._subscribe(self._plans)

    async def tree_snapshots(self) -> "Stream[TreeSnapshot]":
        """Return the behaviour tree: first the present one, then each change."""
        return await self._subscribe(self._trees)

    async def file_events(self) -> Stream[FileNotification]:
        """Return file events from now on, except those during a loss of the link."""
        return await self._subscribe(self._file_events)

    async def retrieve_file(
        self,
        path: str,
        to: Path,
        on_progress: Callable[[int, int], None] = lambda _done, _size: None,
        chunk_octets: int | None = None,
    ) -> FileInfo:
        """Fetch a file over a separate connection; continues an interrupted attempt.

        After a loss of the link the transfer continues. The received octets are stored beside `to`
        in `NAME.CHECKSUM.part`, also after an interruption; `to` exists once the file is complete
        with a correct checksum.

        Args:
            path: the file aboard.
            to: the local file; an existing one is replaced.
            on_progress: called with the received octets and the size.
            chunk_octets: octets of a chunk; None for the rover's default. Smaller for a slow link:
                each chunk must arrive within the session's `timeout_s`.

        Returns:
            The attributes of the file.

        Raises:
            TransferError: the file was changed aboard during the transfer, or the checksum differs.
            OSError: the local file cannot be written.
        """
        file = await self.get_attributes(path)
        session = self._session.separate()
        await session.open(patiently=True)
        try:
            await FileRetrieval(session, file, to, on_progress, chunk_octets).run()
        finally:
            await session.close()
        return file

    async def cancel_transfer(self, path: str) -> None:
        """Cancel this client's transfers of a file; with TLS and the authority, those of all."""
        await self._submit_operation("FileTransfer", "cancelTransfer", path)

    async def file_stored(self, file: FileInfo) -> None:
        """Announce a file that was stored in the onboard folder."""
        await self._submit_operation("FileManagement", "fileStored", file)

    async def send_notification(self, notification: Notification) -> None:
        """Send an event for the rover to report."""
        await self._submit_operation("Notification", "sendNotification", notification)

    async def publish_parameters(self, values: tuple[ParameterValue, ...]) -> None:
        """Send parameter values for the rover to broadcast."""
        await self._submit_operation("Monitoring", "publishParameters", values)

    async def _send_heartbeats(self) -> None:
        """Send heartbeats; further ones while the pending ones cannot have been answered yet."""
        max_count = 1 + int(self.delay.declared_s / HEARTBEAT_S)
        async with asyncio.TaskGroup() as tasks:
            waiting: set[asyncio.Task[None]] = set()
            while True:
                await asyncio.sleep(HEARTBEAT_S)
                if len(waiting) < max_count:
                    task = tasks.create_task(self._send_heartbeat())
                    waiting.add(task)
                    task.add_done_callback(waiting.discard)

    async def _send_heartbeat(self) -> None:
        # An error answer proves the contact, too; without a session nothing is sent.
        with suppress(MalError, ConnectionError):
            now_s = asyncio.get_running_loop().time
            before, sent_s = await self._session.consumer(), now_s()
            last = await self._give_sign()
            if (consumer := await self._session.consumer()) is before:  # it was not sent again
                self.delay = replace(self.delay, measured_s=now_s() - sent_s)
            await self._feed.catch_up(consumer, last)

    async def _give_sign(self) -> ReceivedReport | None:
        """Send a query that the peer supports, so that TCP detects a lost peer.

        Return the last report on a link with a noticeable delay: it may lose whole messages.
        """
        queries = [self.get_status_interval_s, self.get_last_notification]
        first, second = reversed(queries) if self.delay.is_noticeable else queries
        try:
            answer = await first()
        except NotServedError:  # at an orbiter, or without reports; the query was not sent
            answer = await second()
        return answer if isinstance(answer, ReceivedReport) else None

    async def _send_authority_request(self, operation: str, *arguments: Any) -> AuthorityStatus:
        return await self._one(AuthorityStatus, "Authority", operation, *arguments)

    async def _submit_operation(self, service: str, operation: str, *parts: object) -> None:
        consumer = await self._session.consumer()
        try:
            await consumer.submit(service, operation, *parts)
        except MalError as error:
            if error.number not in LINK_LOST_ERRORS:
                raise
            await self._session.drop(consumer)
            raise ConnectionError("the link was lost before the rover answered") from error

    async def _subscribe(self, updates: Updates[T]) -> Stream[T]:
        stream = updates.open()
        await updates.subscribe(await self._session.consumer())
        return stream

    async def _restore(self, consumer: RoverConsumer) -> None:
        with suppress(NotServedError):  # the other services remain usable
            await self._feed.restore(consumer)
        await self._file_events.subscribe(consumer)
        await self._restore_plans(consumer)
        await self._telemetry.subscribe(consumer)
        with suppress(NotServedError):
            await self._trees.subscribe(consumer)

    async def _restore_plans(self, consumer: RoverConsumer) -> None:
        if not self._plans.has_subscribers:
            return
        await self._plans.subscribe(consumer)
        (plans,) = await consumer.request("Plan", "getPlanStatus", ())
        for update in plans:
            if self._last_of_plans.get(update.planId) != plan_update_of(update):
                self._plans.put(self._note_plan(update))

    def _note_plan(self, received: wire.PlanUpdate) -> PlanUpdate:
        update = self._last_of_plans[received.planId] = plan_update_of(received)
        return update

    def _deliver(self, received: ReceivedReport) -> None:
        for watch in self._watches:
            watch.on_report(received)
        self._notifications.put(received)

    def _on_new_ledger(self) -> None:
        fault = ConnectionError(
            "the rover restarted without its ledger, or with an older one: the result of the"
            " command is unknown"
        )
        for watch in self._watches:
            watch.fail(fault)

    def _on_reconnect_failed(self, fault: ConnectionError) -> None:
        self._end(fault, fault)

    def _end(self, of_streams: Exception | None, of_commands: Exception) -> None:
        every = (self._file_events, self._plans, self._notifications, self._telemetry, self._trees)
        for streams in every:
            streams.close(of_streams)
        for watch in self._watches:
            watch.fail(of_commands)
