"""The ground's side of the MRS: commands with their outcome, and what the rover tells."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

from adapters.mal import MalError
from adapters.mrs.ground.authority import SessionAuthority
from adapters.mrs.ground.file_retrieval import FileNotification, FileRetrieval
from adapters.mrs.ground.notification_stream import NotificationStream, Stream, Streams, Updates
from adapters.mrs.ground.outcome import CommandOutcome, CommandWatch, OnNotification, where_stored
from adapters.mrs.ground.queries import LOST, Queries
from adapters.mrs.ground.rover_consumer import NotServedError, RoverConsumer
from adapters.mrs.ground.session import RoverSession, parse_address
from adapters.mrs.ground.tree_stream import TreeUpdates
from adapters.mrs.spec import (
    LINK,
    AreaError,
    AuthorityStatus,
    FileInfo,
    Notification,
    ParameterValue,
    PlanUpdate,
    header_of,
    invocation,
    supplements_of,
)
from adapters.mrs.terms import CLEAR, TransportSettings
from adapters.system import OPERATING_SYSTEM, System, utc_ns
from executive.commands import Command, PreemptionPolicy, Request
from executive.values.reports import Identity

if TYPE_CHECKING:
    from trees import TreeSnapshot

T = TypeVar("T")

SOURCE: Final = "MOE"
"""The name under which people command, unless they give another."""
SIGN_S: Final = 1.0
"""Between two signs to the rover that this end of the link is there."""
SILENCE_S: Final = 1.0
"""A rover tells of a command that it took within this: what is silent for longer waits."""
TRIES: Final = 8
"""How often one command is sent over new connections before it is given up."""
EPOCH_MS: Final = 1_767_225_600_000
"""2026-01-01, from where command numbers count, in ms since 1970 UTC."""


class CommandIdGenerator:
    """Gives milliseconds since 2026, or one more than the last: never 0, never twice.

    A client that starts again goes on above its former numbers, unless it gave more than one a
    millisecond or the clock was set back.

    Args:
        system: the time.
    """

    def __init__(self, system: System = OPERATING_SYSTEM) -> None:
        self._system = system
        self._last = 0

    def take(self) -> int:
        """Return a new number."""
        self._last = max(self._last + 1, utc_ns(self._system) // 1_000_000 - EPOCH_MS)
        return self._last


class MrsClient(Queries):
    """One mission control's session with one rover, over losses of the link.

    After a loss it connects and subscribes again, and catches up with the notifications that it
    missed. While it is connected it asks for something once a second, so that the rover knows that
    it is there, though it may only listen. All methods raise ConnectionError when the rover does
    not come back in time, and MalError when the rover answers with an error.

    Attributes:
        source: the name under which it commands.
        authority: what its commands claim, once it is requested.
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
        """Not to be called; see `connect`."""
        self.source = source
        self.authority = SessionAuthority(self._ask_authority, source)
        address, ends = parse_address(uri), (self._restore, self._give_up)
        super().__init__(RoverSession(address, source, terms, *ends, timeout_s, patience_s, system))
        self._system, self._numbers = system, CommandIdGenerator(system)
        self._watches: list[CommandWatch] = []
        self._notifications: Streams[Notification] = Streams()
        self._feed = NotificationStream(self._deliver, self._on_new_ledger)
        self._telemetry: Updates[ParameterValue] = Updates("Monitoring", "monitorValue")
        self._trees = TreeUpdates()
        self._file_news: Updates[FileNotification] = Updates(
            "FileManagement", "monitorFiles", FileNotification
        )
        self._plans: Updates[PlanUpdate] = Updates("Plan", "monitorPlanExecution", self._note_plan)
        self._last_of_plans: dict[str, PlanUpdate] = {}
        self._signing: asyncio.Task[None] | None = None

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
            source: the name under which to command; None for that of the certificate, and MOE in
                clear text.
            timeout_s: how long to wait for each answer.
            patience_s: how long to try to connect again after a loss; 0 for not at all.
            terms: the encoding and the certificates agreed on with the rover.
            system: the time of messages.

        Raises:
            CertificateError: a certificate file cannot be used.
            ConnectionError: nobody answers there, or the ends do not believe one another.
            ValueError: `to` is no address.
        """
        if source is None and terms.certificates is not None:
            source = terms.certificates.name()
        client = cls(to, source or SOURCE, terms, timeout_s, patience_s, system)
        await client._session.open()
        client._signing = asyncio.create_task(client._give_signs())
        return client

    async def __aenter__(self) -> "MrsClient":
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Hang up; streams end."""
        self.authority.let_go()
        if self._signing is not None:
            self._signing.cancel()
        await self._session.close()
        self._end(None, ConnectionError("the session was closed"))

    def authority_of(self, source: str) -> SessionAuthority:
        """Return what asks for the authority under another name, and leaves its renewal to others.

        So several people command over one session. With certificates the rover knows it under
        their name alone.
        """
        return SessionAuthority(self._ask_authority, source, renews=False)

    def command(
        self,
        request: Request,
        *,
        source: str | None = None,
        command_id: int | None = None,
        lifetime_s: float | None = None,
        arrival: PreemptionPolicy = PreemptionPolicy.APPEND,
        authority: int | None = None,
    ) -> Command:
        """Return a command, made now.

        Args:
            request: what is commanded.
            source: who commands; None for this session.
            command_id: its number; None for a new one.
            lifetime_s: how long it may wait; None for as long as it takes.
            arrival: what it does to motion under way.
            authority: the epoch that it claims; None for that of this session.
        """
        number = self._numbers.take() if command_id is None else command_id
        return Command(
            identity=Identity(source or self.source, number),
            request=request,
            link=LINK,
            created_utc_s=self._system.utc_s(),
            lifetime_s=lifetime_s,
            arrival=arrival,
            authority=self.authority.epoch if authority is None else authority,
        )

    async def run(
        self,
        command: Command,
        on_notification: OnNotification = lambda _: None,
        on_stored: Callable[[str], None] | None = None,
    ) -> CommandOutcome:
        """Send a command and wait until it ends or a relay gives it up, over losses of the link.

        Args:
            command: as `command` makes it.
            on_notification: called with each notification of its life, as it comes.
            on_stored: called with words on where it waits, if it does so at an orbiter.
        """
        watch = CommandWatch(command, on_notification)
        self._watches.append(watch)
        try:
            (await self._session.consumer()).require("Notification", "monitorNotification")
            await self.submit(command)
            if on_stored is not None:
                await self._tell_if_stored(watch, on_stored)
            await watch.ended
            return watch.outcome()
        except MalError as refusal:
            return watch.outcome(refusal)
        finally:
            self._watches.remove(watch)

    async def _tell_if_stored(self, watch: CommandWatch, on_stored: Callable[[str], None]) -> None:
        await asyncio.wait((watch.ended,), timeout=SILENCE_S)
        if watch.has_news:
            return
        where = await where_stored(self.get_value)
        if where is not None and not watch.has_news:
            on_stored(where)

    async def submit(self, command: Command) -> None:
        """Send a command and return when the rover, or the orbiter on the way to it, has taken it.

        When the link is lost before the answer, it is sent again: the rover takes it once only.
        When that happens `TRIES` times, it is the command that ends the link: it is too long.
        """
        call = invocation(command.request)
        for again in range(TRIES):
            consumer = await self._session.consumer()
            try:
                await consumer.submit(
                    call.service,
                    call.operation,
                    header_of(command),
                    *call.parts,
                    supplements=supplements_of(command),
                )
                return
            except MalError as error:
                if error.number == AreaError.DUPLICATE.value and again:
                    return
                if error.number not in LOST:
                    raise
                await self._session.drop(consumer)
        raise ConnectionError(
            f"{self._session.uri} hung up {TRIES} times over {call.service}.{call.operation}:"
            " is it longer than the rover takes?"
        )

    def notifications(self) -> Stream[Notification]:
        """Return the rover's notifications from now on."""
        return self._notifications.open()

    async def telemetry(self) -> Stream[ParameterValue]:
        """Return parameter values from now on."""
        return await self._subscribe(self._telemetry)

    async def plan_updates(self) -> Stream[PlanUpdate]:
        """Return how far plans come from now on; after a loss of the link, first where they are."""
        return await self._subscribe(self._plans)

    async def tree_snapshots(self) -> "Stream[TreeSnapshot]":
        """Return the behaviour tree, first as it is now, then whenever it changes."""
        return await self._subscribe(self._trees)

    async def file_events(self) -> Stream[FileNotification]:
        """Return what happens to files from now on; not what happens while the link is lost."""
        return await self._subscribe(self._file_news)

    async def retrieve_file(
        self,
        path: str,
        to: Path,
        on_progress: Callable[[int, int], None] = lambda _done, _size: None,
        chunk_octets: int | None = None,
    ) -> FileInfo:
        """Fetch a file over a connection of its own, from where a former attempt ended.

        After a loss of the link it goes on with the rest. What came so far lies beside `to`, in
        `NAME.CHECKSUM.part`, also when this is interrupted; `to` is there when all has come and
        its checksum is right.

        Args:
            path: the file aboard.
            to: what it is to be here; a file of that name is replaced.
            on_progress: called with the octets that are here, and those of the whole.
            chunk_octets: of one message, None for the rover's choice. Less for a slow link: each
                chunk has to come within the session's `timeout_s`.

        Returns:
            What the rover says of the file.

        Raises:
            TransferError: the file was changed aboard meanwhile, or what came is not what is there.
            OSError: it cannot be written here.
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
        """End the transfers of a file under this name; with TLS and the authority, those of all."""
        await self._tell("FileTransfer", "cancelTransfer", path)

    async def file_stored(self, file: FileInfo) -> None:
        """Have a file announced that was put into the folder aboard."""
        await self._tell("FileManagement", "fileStored", file)

    async def send_notification(self, notification: Notification) -> None:
        """Have an event reported by the rover."""
        await self._tell("Notification", "sendNotification", notification)

    async def publish_parameters(self, values: tuple[ParameterValue, ...]) -> None:
        """Have parameter values broadcast."""
        await self._tell("Monitoring", "publishParameters", values)

    async def _give_signs(self) -> None:
        with suppress(ConnectionError):
            while True:
                await asyncio.sleep(SIGN_S)
                with suppress(MalError):  # an answer that is an error came all the same
                    await self._give_sign()
                    await self._feed.catch_up(await self._session.consumer())

    async def _give_sign(self) -> None:
        """Ask for something that the other end serves; so that TCP notices a peer that is gone."""
        try:
            await self.get_status_interval_s()
        except NotServedError:  # as by an orbiter: nothing was sent
            await self.get_last_notification()

    async def _ask_authority(self, operation: str, *arguments: Any) -> AuthorityStatus:
        return await self._one(AuthorityStatus, "Authority", operation, *arguments)

    async def _tell(self, service: str, operation: str, *parts: object) -> None:
        consumer = await self._session.consumer()
        try:
            await consumer.submit(service, operation, *parts)
        except MalError as error:
            if error.number not in LOST:
                raise
            await self._session.drop(consumer)
            raise ConnectionError("the link was lost before the rover answered") from error

    async def _subscribe(self, updates: Updates[T]) -> Stream[T]:
        stream = updates.open()
        await updates.subscribe(await self._session.consumer())
        return stream

    async def _restore(self, consumer: RoverConsumer) -> None:
        with suppress(NotServedError):  # what else it serves can be used all the same
            await self._feed.restore(consumer)
        await self._file_news.subscribe(consumer)
        await self._restore_plans(consumer)
        await self._telemetry.subscribe(consumer)
        with suppress(NotServedError):
            await self._trees.subscribe(consumer)

    async def _restore_plans(self, consumer: RoverConsumer) -> None:
        if not self._plans.wanted:
            return
        await self._plans.subscribe(consumer)
        (plans,) = await consumer.request("Plan", "getPlanStatus", ())
        for update in plans:
            if self._last_of_plans.get(update.planId) != update:
                self._plans.put(self._note_plan(update))

    def _note_plan(self, update: PlanUpdate) -> PlanUpdate:
        self._last_of_plans[update.planId] = update
        return update

    def _deliver(self, notification: Notification) -> None:
        for watch in self._watches:
            watch.take(notification)
        self._notifications.put(notification)

    def _on_new_ledger(self) -> None:
        fault = ConnectionError(
            "the rover came back without its ledger, or without that much of it: how the command"
            " ended is not known"
        )
        for watch in self._watches:
            watch.fail(fault)

    def _give_up(self, fault: ConnectionError) -> None:
        self._end(fault, fault)

    def _end(self, of_streams: Exception | None, of_commands: Exception) -> None:
        told = (self._file_news, self._plans, self._notifications, self._telemetry, self._trees)
        for streams in told:
            streams.close(of_streams)
        for watch in self._watches:
            watch.fail(of_commands)
