"""`LiveSession`, mission control of a live run: sends due commands and records the replies.

The record holds notifications and statuses of each link, telemetry, files and the video stream.
"""

import asyncio
import logging
import socket
import tempfile
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, Final, TypeVar

from adapters.mal import MalError
from adapters.mrs.ground import FileNotification, MrsClient, Stream, TransferError
from adapters.mrs.spec import (
    AreaError,
    ReceivedReport,
    ReceivedValue,
    describe_error,
    forwarded_command,
    mode_of,
    received_value,
    rover_values_of,
    utc_s_of,
)
from adapters.mrs.transport import TransportSettings
from adapters.system import OPERATING_SYSTEM, System
from adapters.video import JpegStream
from executive.commands import Command
from executive.values.reports import FileEvent, FileEventKind, Report
from sim.ros.faults import FaultClient
from sim.rover.faults import LinkLost, SimulatedFault, fault_declaration
from sim.scenario.model import (
    Cargo,
    Clear,
    Entry,
    Fetch,
    Inject,
    Outage,
    QueryParameters,
    Repeat,
    RunMode,
    Scenario,
    Send,
)
from sim.scenario.record import (
    AdmittedRequest,
    Answer,
    Datagram,
    FaultChange,
    Fetched,
    FetchFailed,
    ModeSample,
    QueryAnswer,
    Record,
    SeenStatus,
    SentCommand,
)
from sim.scenario.sent import sent_commands
from sim.scenario.timeline import CommandFactory, Timeline

T = TypeVar("T")
_LOG: Final = logging.getLogger(__name__)

MIN_PAUSE_S: Final = 0.005
CONDITION_POLL_S: Final = 0.02
"""Polling period while waiting for a state of the rover."""
POLL_S: Final = 0.1
"""Polling period of the status."""


class LiveSession:
    """Session of one live run.

    An outage of the direct link closes the connection; it is reopened at the end of the outage.
    Over the relay the connection to the orbiter stays open while the orbiter has no contact.

    Args:
        uris: URI of the rover's MRS by the name of the link.
        mode: link of the commands that name none; the only source of telemetry.
        load: sets the mass of the rover's cargo, in kg.
        faults: injects and clears faults of the rover.
        poll: adds the true poses received since its last call to the record.
        record: receives all other data.
        brief: whether the run ends when all entries are done and all admitted commands have ended.
        speed: seconds of the scenario per second, if the simulation is fast enough.
        system: clock.
        on_update: called with the record after each addition.
        round_trip_s: light time of the direct link, for timeouts.
    """

    def __init__(
        self,
        scenario: Scenario,
        uris: Mapping[str, str],
        mode: RunMode,
        load: Callable[[float], None] | None,
        faults: FaultClient | None,
        poll: Callable[[], None],
        record: Record,
        brief: bool = False,
        speed: float = 1.0,
        system: System = OPERATING_SYSTEM,
        on_update: Callable[[Record], None] = lambda _: None,
        round_trip_s: float = 0.0,
    ) -> None:
        self._system = system
        self._terms = TransportSettings(round_trip_s=round_trip_s)
        self._uris, self._mode, self._load, self._brief = uris, mode, load, brief
        self._on_update = on_update
        self._poll = poll
        self._speed = speed
        self._entries = len(scenario.timeline)
        self._record = record
        record.main_link = mode.link
        self._duration_s = scenario.duration_s
        self._timeline = Timeline(scenario, record)
        self._ground = CommandFactory(scenario, mode.link, speed)
        self._lines: dict[str, DownlinkSubscriptions] = {}
        self._faults = faults
        self._contact_s = inf
        self._lost = False
        self._last_cursor = 0
        self._new_data = asyncio.Event()

    async def play(self) -> None:
        """Run to the end.

        Raises:
            ConnectionError: the connection to the rover was lost.
        """
        try:
            for link in self._uris:
                await self._connect(link)
            await self._send()
            for line in self._lines.values():
                line.check()
        finally:
            for link in self._uris:
                await self._hang_up(link)
        self._record.simulated_s = self._now_s()
        self._record.wall_s = self._system.utc_s() - self._record.start_utc_s

    def _now_s(self) -> float:
        return self._record.since_start_s(self._system.utc_s())

    async def _connect(self, link: str) -> "DownlinkSubscriptions":
        client = await MrsClient.connect(self._uris[link], terms=self._terms, system=self._system)
        line = DownlinkSubscriptions(client, self._record, link, self._system, self._on_change)
        self._lines[link] = line
        await line.begin()
        return line

    async def _hang_up(self, link: str) -> None:
        line = self._lines.pop(link, None)
        if line is not None:
            self._last_cursor = line.last_cursor
            await line.end()

    def _on_change(self) -> None:
        self._new_data.set()
        self._on_update(self._record)

    @property
    def _client(self) -> MrsClient | None:
        """Client of the run's link; None while disconnected."""
        line = self._lines.get(self._mode.link)
        return None if line is None else line.client

    async def _send(self) -> None:
        while (now_s := self._now_s()) < self._duration_s and not (self._brief and self._done):
            if now_s >= self._contact_s and not self._lost:
                self._contact_s = inf
                line = await self._connect(self._mode.link)
                await line.catch_up(self._last_cursor + 1)
            if self._timeline.has_position_triggers:
                self._poll()
            for entry in self._timeline.due(now_s):
                await self._carry_out(entry)
                self._record.played += 1
            self._new_data.clear()
            contact_s = inf if self._lost else self._contact_s
            until_s = min(self._timeline.next_s(), contact_s, self._duration_s)
            pause_s = max(MIN_PAUSE_S, until_s - self._now_s()) / self._speed
            if self._timeline.has_position_triggers:
                pause_s = min(pause_s, CONDITION_POLL_S)
            with suppress(TimeoutError):
                async with asyncio.timeout(pause_s):
                    await self._new_data.wait()

    @property
    def _done(self) -> bool:
        record = self._record
        return record.played == self._entries and all(sent.ending for sent in sent_commands(record))

    async def _carry_out(self, entry: Entry) -> None:
        match entry:
            case Send() | Repeat():
                label, command = self._ground.command(entry, self._system.utc_s())
                await self._submit(label, command)
            case QueryParameters(query=label):
                self._record.answers.append(await self._query_answer(label))
            case Fetch(fetch=path):
                if self._client is None:
                    self._record.fetched.append(FetchFailed(path, "no contact"))
                    return
                self._record.fetched.append(await fetched(self._client, path, self._record.files))
            case Cargo(cargo_kg=mass_kg) if self._load is not None:
                self._load(mass_kg)
            case Inject(inject=fault):
                await self._set_fault(type(fault), fault)
            case Clear(clear=kind):
                await self._set_fault(kind, None)
            case Outage(outage_s=dark_s):
                if self._mode is RunMode.DIRECT:
                    await self._hang_up(self._mode.link)
                    self._contact_s = self._now_s() + dark_s
            case _:
                raise TypeError(f"{type(entry).__name__} is not possible in a live run")

    async def _set_fault(self, kind: type[SimulatedFault], begins: SimulatedFault | None) -> None:
        """Inject a fault, or clear the fault of a kind."""
        if kind is LinkLost:
            await self._lose_link(begins is not None)
        else:
            assert self._faults is not None
            if begins is not None:
                await asyncio.to_thread(self._faults.inject, begins)
            else:
                await asyncio.to_thread(self._faults.clear, kind)
        name = fault_declaration(kind).name
        self._record.faults.append(FaultChange(self._now_s(), name, begins is not None))

    async def _lose_link(self, lost: bool) -> None:
        """Disconnect until the link is available again and no outage lasts."""
        self._lost = lost
        if lost:
            await self._hang_up(self._mode.link)
        if self._client is None and self._contact_s == inf:
            self._contact_s = self._now_s()

    async def _submit(self, label: str, command: Command) -> None:
        record, sent_s, text = self._record, self._now_s(), ""
        record.first_links.setdefault(command.identity, command.link)
        line, answer = self._lines.get(command.link), Answer.ACCEPTED
        if line is None:
            answer = Answer.LOST
        else:
            try:
                await line.client.submit(command)
            except MalError as error:
                known = error.number == AreaError.DUPLICATE.value
                answer, text = Answer.DUPLICATE if known else Answer.REJECTED, describe_error(error)
        identity = command.identity
        _LOG.info("%s %s by %s: %s %s", identity, label, command.link, answer.value, text)
        record.sendings.append(
            SentCommand(label, identity, sent_s, answer, command.link, text, self._now_s())
        )
        received = answer in (Answer.ACCEPTED, Answer.REJECTED)
        if received and all(each.identity != identity for each in record.requested):
            record.requested.append(AdmittedRequest(identity, command.request))
        self._on_update(record)

    async def _query_answer(self, label: str) -> QueryAnswer:
        if self._client is None:
            return QueryAnswer(label, (), ())
        values = rover_values_of(await self._client.get_value())
        direct = self._mode is RunMode.DIRECT
        files = await self._client.list_files() if direct else ()
        return QueryAnswer(
            label, self._record.received_values(values), tuple(file.path for file in files)
        )


class DownlinkSubscriptions:
    """Subscriptions of one client, from `begin` to `end`, which closes the client.

    Args:
        link: link of the client. All but reports and status is received on the run's link only.
    """

    def __init__(
        self,
        client: MrsClient,
        record: Record,
        link: str,
        system: System,
        on_data: Callable[[], None],
    ) -> None:
        self.client = client
        self._record = record
        self._link, self._system = link, system
        self._main = record.main_link
        self._on_data = on_data
        self.last_cursor = 0
        self._notifications = client.notifications()
        self._tasks: list[asyncio.Task[None]] = []

    async def begin(self) -> None:
        """Start the subscriptions and the polling of the status."""
        client, record = self.client, self._record

        def on_report(received: ReceivedReport) -> None:
            self._receive([received])
            self._on_data()

        def on_value(value: ReceivedValue) -> None:
            record.values += record.received_values(rover_values_of([value]))

        def on_file(notification: FileNotification) -> None:
            record.file_events.append(FileEvent(notification.event, notification.file.path))

        self._start(_forward_items(self._notifications, on_report))
        if self._link == self._main:
            self._start(_forward_items(await client.telemetry(), on_value))
        if self._link == self._main == RunMode.DIRECT.link:
            self._start(_forward_items(await client.file_events(), on_file))
            self._start(_forward_items(await client.plan_updates(), record.plans.append))
        self._start(self._poll())

    async def catch_up(self, since: int) -> None:
        """Retrieve the reports from a cursor on; telemetry made while disconnected is lost."""
        record, client = self._record, self.client
        self._receive(await client.get_all_notifications(since))
        record.plans += await client.get_plan_status()
        known = {event.path for event in record.file_events}
        listed = [file.path for file in await client.list_files()]
        record.file_events += [
            FileEvent(FileEventKind.STORED, path) for path in listed if path not in known
        ]
        self._on_data()

    def check(self) -> None:
        """Raise the exception that ended a subscription, if any."""
        for task in self._tasks:
            if task.done():
                task.result()

    async def end(self) -> None:
        """Cancel the subscriptions and close the client."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await self.client.close()

    def _receive(self, received: Sequence[ReceivedReport]) -> None:
        self.last_cursor = max([self.last_cursor, *(each.cursor for each in received)])
        reports = (_report(each.report) for each in received)
        self._record.receive(reports, self._link, self._system.utc_s())

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        self._tasks.append(asyncio.create_task(work))

    async def _poll(self) -> None:
        record = self._record
        while True:
            status = await self.client.get_status()
            mode = mode_of(status.mode)
            made_s = record.since_start_s(utc_s_of(status.timestamp))
            if mode is not None and self._link == self._main:
                record.modes.append(ModeSample(made_s, mode))
            values = {
                each.name: each.value
                for each in map(received_value, status.values)
                if isinstance(each.value, float)
            }
            seen_s = record.since_start_s(self._system.utc_s())
            seen = SeenStatus(seen_s, seen_s - made_s, self._link, mode, values)
            record.statuses.append(seen)
            self._on_data()
            await asyncio.sleep(POLL_S)


def _report(report: Report) -> Report:
    """Return the report; that a command was forwarded, without the identity of the command."""
    return replace(report, identity=None) if forwarded_command(report) else report


async def _forward_items(stream: Stream[T], put: Callable[[T], None]) -> None:
    async for item in stream:
        put(item)


async def fetched(client: MrsClient, path: str, aboard: Path) -> Fetched | FetchFailed:
    """Fetch a file.

    Args:
        client: connected client of the rover.
        path: path of the file in the folder aboard.
        aboard: that folder, readable because the rover is simulated.

    Raises:
        ConnectionError: the connection to the rover was lost.
    """
    with tempfile.TemporaryDirectory(prefix="rover-fetched-") as folder:
        here = Path(folder) / "fetched"
        try:
            file = await client.retrieve_file(path, here)
        except MalError as error:
            return FetchFailed(path, describe_error(error))
        except TransferError as error:
            return FetchFailed(path, str(error))
        assert file.checksum is not None
        return Fetched(path, here.read_bytes(), (aboard / path).read_bytes(), file.checksum)


class _DatagramRecorder(asyncio.DatagramProtocol):
    def __init__(self, record: Record) -> None:
        self._record = record
        self._stream = JpegStream()

    def datagram_received(self, data: bytes, _: object) -> None:
        time_s = self._record.since_start_s(time.time())
        self._record.video.append(Datagram(time_s, self._stream.add(data)))


@asynccontextmanager
async def watched(ground: socket.socket, record: Record) -> AsyncIterator[None]:
    """Record every received datagram."""
    loop = asyncio.get_running_loop()
    own = ground.dup()
    own.setblocking(False)
    transport, _ = await loop.create_datagram_endpoint(lambda: _DatagramRecorder(record), sock=own)
    try:
        yield
    finally:
        transport.close()
