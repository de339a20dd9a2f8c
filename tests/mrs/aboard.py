"""A rover as it is aboard: its core on a thread of its own, its direct link on a real socket."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import pytest
from click.testing import CliRunner, Result

from adapters.cli.main import main
from adapters.mal import AttributeType, Consumer, MalError, MalUri, TypedAttribute, TypedList
from adapters.mrs.ground import CommandOutcome, MrsClient
from adapters.mrs.link import HousekeepingSource, MrsLink
from adapters.mrs.spec import (
    CommandHeader,
    Notification,
    NotificationKind,
    ParameterValue,
    ReceivedReport,
    Severity,
    Stage,
    Validity,
    mrs_specification,
)
from adapters.mrs.transport import CLEAR, TransportSettings
from executive.commands import Request
from executive.core.runner import Executive
from executive.history.history_builder import HistoryBuilder
from executive.settings import AuthoritySettings, load_settings
from executive.values.ports import Downlink
from tests.support.kinematic import Bench
from tests.support.ports import free_port
from trees import leaf_paths

T = TypeVar("T")

ANSWER_S = 60.0
BUSY_S, IDLE_S = 0.001, 0.01
"""Real time from tick to tick; while no command is under way, a page waits for little."""
RETAINED = 1000
WITHOUT_AUTHORITY = AuthoritySettings()
HEADER = CommandHeader(commandId=1, source="MOE", reportStarted=True, reportProgress=True)


def rover(*arguments: str) -> Result:
    """Type `rover` with arguments."""
    return CliRunner().invoke(main, arguments)


@contextmanager
def raises(number: int, *arguments: int) -> Iterator[None]:
    """Expect the error of a number, and of Invalid the indexes of the arguments, if given."""
    with pytest.raises(MalError) as raised:
        yield
    assert raised.value.number == number
    if arguments:
        assert raised.value.extra == TypedList(AttributeType.UINTEGER, arguments)


def stages(outcome: CommandOutcome) -> list[Stage | None]:
    """Return the stages of a command's life."""
    return [report.stage for report in outcome.reports]


def number_of(received: ReceivedReport) -> int | None:
    """Return the number of the command that a report is of."""
    identity = received.report.identity
    return None if identity is None else identity.command_id


def event(**changes: Any) -> Notification:
    """Return a notification of an event."""
    dust = Notification(
        kind=NotificationKind.EVENT,
        severity=Severity.ALARM,
        timestamp=0,
        sequence=0,
        text="the lens is dusty",
    )
    return replace(dust, **changes)


def reading(
    name: str, value: TypedAttribute | float | None = 1.0, **changes: Any
) -> ParameterValue:
    """Return a value of a parameter: a Double, unless it says otherwise; INVALID without any."""
    validity = Validity.INVALID if value is None else Validity.VALID
    typed = TypedAttribute(AttributeType.DOUBLE, value) if isinstance(value, float) else value
    return replace(
        ParameterValue(name=name, timestamp=0, validity=validity, value=typed), **changes
    )


class LinkedBench(Bench):
    """A bench whose executive reports to a direct link too."""

    def __init__(
        self,
        folder: Path,
        port: int,
        terms: TransportSettings,
        asset: str,
        service_layer: str | None,
        authority: AuthoritySettings,
        explains: bool,
        housekeeping: HousekeepingSource | None,
        recordings: Path | None,
    ) -> None:
        self._recordings = recordings
        self._housekeeping = housekeeping
        self._history = HistoryBuilder(leaf_paths, RETAINED) if explains else None
        self._port = port
        self._terms = terms
        self._service_layer = None if service_layer is None else MalUri.parse(service_layer)
        settings = replace(
            load_settings("jackal"), asset=asset, domain=("meteron", asset), authority=authority
        )
        super().__init__(folder, settings, tape=self._history)

    def _start(self) -> Executive:
        self.link = MrsLink(
            self.settings,
            port=self._port,
            terms=self._terms,
            service_layer=self._service_layer,
            history=self._history,
            housekeeping=self._housekeeping,
            recordings=self._recordings,
        )
        return super()._start()

    def downlinks(self) -> list[Downlink]:
        if self._history is not None:
            self._history.restore(self.ledger.reports(1, count=RETAINED))
        return [self.received, self.link]


class Aboard:
    """A rover whose time stands still, or runs by itself.

    It is some fifty times as fast as real time while a command is under way, otherwise five times.

    Attributes:
        runs: whether time runs by itself.
        port, uri: where the MRS is served.
        terms: on what terms.
        asset: its name.
        service_layer: the URI of another's service layer, where it registers.
        authority: who may command it.
        explains: whether it tells why.
        housekeeping: measures how it is doing.
        recordings: the folder of its recordings.
    """

    def __init__(
        self,
        folder: Path,
        port: int | None = None,
        terms: TransportSettings = CLEAR,
        asset: str = "jackal",
        service_layer: str | None = None,
        authority: AuthoritySettings = WITHOUT_AUTHORITY,
        explains: bool = False,
        housekeeping: HousekeepingSource | None = None,
        recordings: Path | None = None,
    ) -> None:
        self.recordings = recordings
        self.housekeeping = housekeeping
        self.authority = authority
        self.explains = explains
        self.runs = False
        self._ended = False
        self.terms = terms
        self.asset = asset
        self.service_layer = service_layer
        self.port = port or free_port()
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._bench: LinkedBench | None = None
        self._thread = threading.Thread(
            target=self._serve, args=(folder,), name="core", daemon=True
        )
        self._thread.start()
        self.uri = self.do(self._open)

    def do(self, act: Callable[[LinkedBench], T]) -> T:
        """Have something done on the core's thread."""
        answer: Future[T] = Future()

        def job() -> None:
            assert self._bench is not None
            try:
                answer.set_result(act(self._bench))
            except Exception as error:
                answer.set_exception(error)

        self._jobs.put(job)
        return answer.result(ANSWER_S)

    def put(self, path: str, octets: bytes) -> Path:
        """Have a file aboard that nobody told of."""
        path_aboard: Path = self.do(lambda bench: bench.executive.files.root) / path
        path_aboard.parent.mkdir(parents=True, exist_ok=True)
        path_aboard.write_bytes(octets)
        return path_aboard

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        self.do(lambda bench: bench.run(duration_s))

    def ground(self, session: Callable[[MrsClient], Awaitable[T]]) -> T:
        """Hold a session from the ground."""

        async def hold() -> T:
            async with await MrsClient.connect(self.uri, terms=self.terms) as client:
                return await session(client)

        return asyncio.run(hold())

    def carry_out(self, *requests: Request) -> list[CommandOutcome]:
        """Let time run and send requests, each when the one before has ended."""
        self.runs = True

        async def session(client: MrsClient) -> list[CommandOutcome]:
            return [await client.run(client.command(request)) for request in requests]

        return self.ground(session)

    def consume(self, session: Callable[[Consumer], Awaitable[T]]) -> T:
        """Hold a session below the client: operations by name, parts as they are."""

        async def hold() -> T:
            consumer = await Consumer.connect(mrs_specification(), self.uri)
            try:
                return await session(consumer)
            finally:
                await consumer.close()

        return asyncio.run(hold())

    def hang_up(self) -> None:
        """Close the link; reports are not heard from now on."""
        self.do(lambda bench: bench.link.close())

    def listen(self) -> None:
        """Serve the link at its address again."""
        self.do(lambda bench: bench.link.start(bench.executive))

    def die(self) -> None:
        """End as kill -9 does: nothing is said, and what was not written down is lost."""
        self.do(lambda bench: bench.link.close())
        self._end(lambda bench: bench.executive.simulate_crash())

    def close(self) -> None:
        def end(bench: LinkedBench) -> None:
            bench.executive.close()
            bench.link.close()

        self._end(end)

    def _end(self, act: Callable[[LinkedBench], None]) -> None:
        if self._ended:
            return

        def last(bench: LinkedBench) -> None:
            self._ended = True
            act(bench)

        self.do(last)
        self._jobs.put(None)
        self._thread.join(ANSWER_S)

    def _open(self, bench: LinkedBench) -> str:
        bench.executive.wake = lambda: self._jobs.put(self._turn)
        return str(bench.link.start(bench.executive))

    def _turn(self) -> None:
        assert self._bench is not None
        if not self._ended:
            self._bench.executive.serve_inbox()

    def _step_s(self) -> float:
        assert self._bench is not None
        executive = self._bench.executive
        return BUSY_S if executive.goal_count or executive.active_plan else IDLE_S

    def _serve(self, folder: Path) -> None:
        self._bench = LinkedBench(
            folder,
            self.port,
            self.terms,
            self.asset,
            self.service_layer,
            self.authority,
            self.explains,
            self.housekeeping,
            self.recordings,
        )
        while True:
            try:
                job = self._jobs.get(timeout=self._step_s() if self.runs else None)
            except Empty:
                if not self._ended:
                    self._bench.step()
                continue
            if job is None:
                return
            job()
