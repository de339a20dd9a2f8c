"""What foreign stacks send and serve: each gets an answer that says what to do, no traceback."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager, suppress
from dataclasses import replace

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    NamedValue,
    Provider,
    ServiceId,
    StandardError,
    TypedAttribute,
)
from adapters.mrs.aboard.file_services import MAX_TRANSFERS
from adapters.mrs.ground import MrsClient
from adapters.mrs.ground.rover_consumer import NotServedError
from adapters.mrs.spec import (
    AreaError,
    AssetInfo,
    AssetMode,
    CommandHeader,
    FileInfo,
    ServiceDescriptor,
    describe_error,
    mrs_specification,
)
from executive.commands import MoveForward
from tests.mrs.aboard import Aboard, event, rover

STARTED = CommandHeader(commandId=1, source="MOE", reportStarted=True, reportProgress=True)
TRACE = "java.lang.NullPointerException\n\tat esa.mo.mal.impl.Interaction.handle"


def part_of_the_mrs() -> Provider:
    """Return a provider of a Service Layer, listFiles and moveForward, as its directory says."""
    provider = Provider(
        mrs_specification(), "MRS", not_served=MalError(StandardError.INTERNAL, _text(TRACE))
    )
    asset = AssetInfo(
        asset="foreign", domain=(), description="", softwareVersion="", mode=AssetMode.IDLE
    )

    def listed() -> tuple[ServiceDescriptor, ...]:
        return tuple(
            ServiceDescriptor(
                name=name,
                service=ServiceId(keyArea=3001, keyService=number, keyAreaVersion=1),
                providerURI=str(provider.uri),
                operations=operations,
            )
            for name, number, operations in (
                ("ServiceLayer", 1, (1, 5)),
                ("Monitoring", 3, (4,)),
                ("FileTransfer", 4, (1,)),
                ("MotionControl", 8, (1,)),
            )
        )

    provider.serve("ServiceLayer", "getServices", lambda _: (listed(),))
    provider.serve("ServiceLayer", "getAsset", lambda _: (asset,))
    provider.serve("Monitoring", "listDefinition", lambda _: ((),))
    return provider


def _text(text: str) -> TypedAttribute:
    return TypedAttribute(AttributeType.STRING, text)


@contextmanager
def serving(provider: Provider) -> Iterator[str]:
    """Serve on a thread, so that the commands of a terminal can be tried beside it."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    try:
        asyncio.run_coroutine_threadsafe(provider.start(), loop).result(10.0)
        yield str(provider.uri)
        asyncio.run_coroutine_threadsafe(provider.close(), loop).result(10.0)
    finally:
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()


@pytest.fixture(scope="module")
def foreign() -> Iterator[str]:
    with serving(part_of_the_mrs()) as uri:
        yield uri


@pytest.mark.parametrize(
    ("typed", "missing"),
    [
        ("status", "Camera"),
        ("status --assets", "MonitoringClient"),
        ("files info a.jpg", "FileManagement"),
        ("files fetch a.jpg", "FileManagement"),
        ("files cancel a.jpg", "FileTransfer.cancelTransfer"),
        ("files watch", "FileManagement"),
        ("plan status", "Plan"),
        ("plan watch", "Plan"),
        ("command moveForward 1", "Notification"),
    ],
)
def test_an_unserved_operation_is_named(foreign: str, typed: str, missing: str) -> None:
    reported = (
        rover(*typed.split(), "--to", foreign)
        if typed[0] != "c"
        else rover("command", "--to", foreign, *typed.split()[1:])
    )
    assert reported.exit_code == 1, reported.output
    assert f"{foreign} does not serve {missing}\n" in reported.output
    assert "Traceback" not in reported.output
    assert "NullPointer" not in reported.output


def test_a_served_operation_can_be_used(foreign: str) -> None:
    async def session() -> None:
        async with await MrsClient.connect(foreign) as client:
            assert (await client.get_asset()).asset == "foreign"
            with pytest.raises(NotServedError, match=r"does not serve MotionControl\.getPose"):
                await client.get_pose()

    asyncio.run(session())
    assert rover("services", "--to", foreign).exit_code == 0


CAMERA = ServiceDescriptor(
    name="arm.Camera",
    service=ServiceId(keyArea=3001, keyService=7, keyAreaVersion=1),
    providerURI="maltcp://127.0.0.1:9/Arm",
    operations=(1,),
)
FILE = FileInfo(path="a.jpg", size=3, modified=0)


@pytest.mark.parametrize(
    ("service", "operation", "part", "reason"),
    [
        (
            "ServiceLayer",
            "registerService",
            replace(CAMERA, name="Kamera"),
            "name: must be NAME.Camera",
        ),
        ("ServiceLayer", "registerService", replace(CAMERA, name="x" * 65), "1 to 64 printable"),
        ("ServiceLayer", "registerService", replace(CAMERA, operations=(99,)), "Camera has no 99"),
        ("ServiceLayer", "registerService", replace(CAMERA, operations=()), "1 to 256 numbers"),
        ("ServiceLayer", "registerService", replace(CAMERA, providerURI="x"), "maltcp://HOST:PORT"),
        ("FileManagement", "fileStored", FILE, "file: at a.jpg there is no file"),
        ("Notification", "sendNotification", event(text=None), "text: 1 to 4096 characters"),
        (
            "Notification",
            "sendNotification",
            event(parameters=(NamedValue(name="dust", value=_text("much")),)),
            "parameters: dust is not a finite number",
        ),
    ],
)
def test_invalid_gives_the_reason_if_there_is_no_command(
    aboard: Aboard, service: str, operation: str, part: object, reason: str
) -> None:
    async def session(consumer: Consumer) -> None:
        with pytest.raises(MalError) as raised:
            await consumer.submit(service, operation, part)
        message = describe_error(raised.value)
        assert message.startswith("Invalid: ")
        assert reason in message

    aboard.consume(session)


def test_a_chunk_is_no_larger_than_the_bound_for_any_request(aboard: Aboard) -> None:
    aboard.put("film.avi", bytes(600_000))

    async def session(consumer: Consumer) -> list[int]:
        requested = ("film.avi", None, 1_000_000)
        async with consumer.progress("FileTransfer", "retrieveFile", *requested) as progress:
            return [len(chunk.data) async for (chunk,) in progress]

    assert aboard.consume(session) == [1 << 18, 1 << 18, 600_000 - (2 << 18)]


FILM_OCTETS = 30_000_000
RETRIEVE = ("FileTransfer", "retrieveFile")


async def rest(consumer: Consumer) -> list[int]:
    """Fetch the last octet of a film."""
    async with consumer.progress(*RETRIEVE, "film.avi", FILM_OCTETS - 1, None) as progress:
        return [len(chunk.data) async for (chunk,) in progress]


@pytest.mark.at_length
def test_transfers_without_a_reader_are_replaced(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    yields_s = "adapters.mrs.aboard.file_services.PREEMPTIBLE_AFTER_S"
    monkeypatch.setattr(yields_s, 60.0)
    aboard.put("film.avi", bytes(FILM_OCTETS))

    async def session(consumer: Consumer) -> None:
        async with AsyncExitStack() as stalled, asyncio.timeout(30.0):
            for _ in range(MAX_TRANSFERS):
                peer = await Consumer.connect(mrs_specification(), aboard.uri)
                stalled.push_async_callback(peer.close)
                await stalled.enter_async_context(peer.progress(*RETRIEVE, "film.avi", None, None))
            with pytest.raises(MalError) as raised:
                await rest(consumer)
            assert raised.value.number == AreaError.BUSY.value
            monkeypatch.setattr(yields_s, 0.0)
            assert await rest(consumer) == [1]

    aboard.consume(session)


@pytest.mark.parametrize(
    ("header", "preemption"),
    [
        (STARTED, TypedAttribute(AttributeType.STRING, "replace")),
        (STARTED, TypedAttribute(AttributeType.IDENTIFIER, "at once")),
        (replace(STARTED, source="M" * 5000), None),
    ],
)
def test_an_invalid_header_is_named_and_does_not_prevent_a_stop(
    aboard: Aboard, header: CommandHeader, preemption: TypedAttribute | None
) -> None:
    supplements = () if preemption is None else (NamedValue(name="preemption", value=preemption),)

    async def session(consumer: Consumer) -> None:
        with pytest.raises(MalError) as raised:
            await consumer.submit(
                "MotionControl", "moveForward", header, 1.0, supplements=supplements
            )
        message = describe_error(raised.value)
        assert message.startswith(
            "Invalid: supplement preemption" if preemption else "Invalid: argument 0"
        )
        with suppress(MalError):  # what is wrong with it may be said afterwards
            await consumer.submit("MotionControl", "stop", header, supplements=supplements)

    aboard.consume(session)
    assert aboard.do(lambda bench: bench.executive.mode).name == "STOPPED"


def test_a_repeat_without_stored_reports_is_not_treated_as_another_command(
    aboard: Aboard,
) -> None:
    async def session(client: MrsClient) -> None:
        await client.submit(client.command(MoveForward(1.0), command_id=5))

    aboard.ground(session)
    reported = rover("command", "--to", aboard.uri, "--id", "5", "moveForward", "2")
    assert reported.exit_code == 1
    assert (
        "MOE:5 was accepted before, as this or another command, and is not executed again"
        in reported.output
    )


def test_an_invalid_operation_without_a_command_is_in_the_log_with_peer_and_reason(
    aboard: Aboard, caplog: pytest.LogCaptureFixture
) -> None:
    async def session(consumer: Consumer) -> None:
        file = FileInfo(path="a.jpg", size=1, mimeType="", modified=0)
        for operation in (
            consumer.submit("FileManagement", "fileStored", file),
            consumer.submit("Notification", "sendNotification", event(text="")),
        ):
            with pytest.raises(MalError):
                await operation
        with pytest.raises(MalError):
            async with consumer.progress("FileTransfer", "retrieveFile", "a", None, 0):
                pass

    caplog.set_level("WARNING")
    aboard.consume(session)
    reported = [each for each in caplog.messages if "error 1 for" in each]
    assert all("from 127.0.0.1:" in each for each in reported)
    for reason in ("at a.jpg there is no file", "text: 1 to", "chunkSize: at least 1 octet"):
        assert sum(reason in each for each in reported) == 1, reported
