"""A broker that publishers and subscribers in other processes share."""

import asyncio
import dataclasses
import signal
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from adapters.mal import (
    AttributeType,
    Consumer,
    EncodeError,
    Encoding,
    InteractionStage,
    MalError,
    NullableAttribute,
    PeerLimits,
    Publication,
    StandardError,
    Subscription,
    TypedAttribute,
    UpdateHeader,
    encode_message,
)
from adapters.mal.codec import decode_message
from adapters.mal.connection import Framer
from tests.mal.broker_process import main
from tests.mal.test_pubsub import Updates
from tests.mal.wiretest import FILE, SERVICE, SPECIFICATION, XML, Rec, cut, error_of, provided

MONITOR = "monitor"
CAPTURED = [
    (vector["sender"], bytes.fromhex(vector["message"]))
    for vector in FILE["vectors"]
    if vector["setup"] == "shared-broker" and vector["encoding"] == "fixed"
]


@asynccontextmanager
async def client(uri: Any, **options: Any) -> AsyncIterator[Consumer]:
    consumer = await Consumer.connect(SPECIFICATION, uri, is_broker=True, **options)
    try:
        yield consumer
    finally:
        await consumer.close()


async def publish(publication: Publication, value: float, **changes: Any) -> None:
    options = {"keys": ("POS_X", 7), "domain": ("esa", "rover1"), "source": "r", **changes}
    typed = TypedAttribute(AttributeType.DOUBLE, value)
    await publication.publish(typed, Rec(name="r", ok=True), **options)


def restamped(message: bytes, timestamp_ns: int | None) -> bytes:
    header, body = decode_message(message)
    return encode_message(dataclasses.replace(header, timestamp_ns=timestamp_ns), body)


async def test_the_captured_messages_get_the_captured_answers() -> None:
    sent = sorted(
        (message for sender, message in CAPTURED if sender != "broker"),
        key=lambda message: decode_message(message)[0].timestamp_ns or 0,
    )
    wanted = [restamped(message, 0) for sender, message in CAPTURED if sender == "broker"]

    got: list[bytes] = []
    async with provided(name="SharedBroker") as provider:
        provider.open(SERVICE, MONITOR)
        reader, writer = await asyncio.open_connection(provider.uri.host, provider.uri.port)
        framer = Framer()
        writer.write(b"".join(sent))
        while len(got) < len(wanted):
            octets = await reader.read(1 << 16)
            got += (restamped(message, 0) for message in cut(framer, octets))
        writer.close()
    assert sorted(got) == sorted(wanted)


@pytest.mark.parametrize("encoding", list(Encoding))
async def test_updates_go_from_process_to_process(encoding: Encoding) -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "tests.mal.broker_process", str(XML)),
        *("--encoding", encoding.name.lower(), "--droppable", "Vectors.monitor"),
        stdout=asyncio.subprocess.PIPE,
    )
    assert process.stdout is not None
    uri = (await process.stdout.readline()).decode().strip()
    async with (
        client(uri, name="rover1", encoding=encoding) as publisher,
        client(uri, name="MOE", encoding=encoding) as subscriber,
    ):
        updates = Updates()
        await subscriber.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), updates)
        publication = await publisher.publication(SERVICE, MONITOR)
        for number in range(100):
            await publish(publication, float(number))
        assert await updates.have(100) == [float(number) for number in range(100)]
        assert updates.seen[0][0] == UpdateHeader(
            source="r",
            domain=("esa", "rover1"),
            keyValues=(
                NullableAttribute(value=TypedAttribute(AttributeType.IDENTIFIER, "POS_X")),
                NullableAttribute(value=TypedAttribute(AttributeType.LONG, 7)),
            ),
        )
        await publication.close()
        process.send_signal(signal.SIGTERM)
        await publisher.wait_lost()
        await subscriber.wait_lost()
    assert await process.wait() == 0


async def refused(publication: Publication) -> int:
    """Publish until an earlier update is refused."""
    while True:
        try:
            await publish(publication, 1.0)
        except MalError as error:
            return error.number


async def test_an_unregistered_publisher_may_not_publish() -> None:
    async with provided() as provider, client(provider.uri) as publisher:
        error = await error_of(publisher.publication(SERVICE, MONITOR))
        assert error.number == StandardError.UNSUPPORTED_OPERATION.value
        provider.open(SERVICE, MONITOR)
        publication = await publisher.publication(SERVICE, MONITOR)
        async with client(provider.uri, name="other") as other:
            stranger = Publication(other, SPECIFICATION.operation(SERVICE, MONITOR))
            other._pending[stranger._number] = stranger._refusals
            assert await refused(stranger) == StandardError.INCORRECT_STATE.value
            updates = Updates()
            await other.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), updates)
            await publish(publication, 5.0)
            assert await updates.have(1) == [5.0]
        await publication.close()
        publisher._pending[publication._number] = publication._refusals
        assert await refused(publication) == StandardError.INCORRECT_STATE.value
        with pytest.raises(EncodeError):
            await publish(publication, 1.0, keys=("POS_X", "seven"))
        with pytest.raises(ValueError, match="argument"):
            await publish(publication, 1.0, keys=("POS_X",))
        with pytest.raises(ValueError, match="not a PUBSUB"):
            provider.open(SERVICE, "doRequest")


async def test_a_publisher_that_is_lost_is_forgotten() -> None:
    async with provided() as provider:
        provider.open(SERVICE, MONITOR)
        async with client(provider.uri) as publisher:
            publication = await publisher.publication(SERVICE, MONITOR)
            assert provider._broker._publishers
        error = await error_of(publish(publication, 1.0))
        assert error.number == StandardError.DESTINATION_LOST.value
        while provider._broker._publishers:
            await asyncio.sleep(0)


KEYS = ("parameter", "asset")
TYPES = (AttributeType.IDENTIFIER, AttributeType.LONG)


@pytest.mark.parametrize(
    ("names", "types"),
    [
        (KEYS, (AttributeType.STRING, AttributeType.LONG)),
        (("parameter",), (AttributeType.IDENTIFIER,)),
        (("parameter", "colour"), TYPES),
        (KEYS, (AttributeType.IDENTIFIER,)),
        (("parameter", "parameter"), TYPES),
    ],
)
async def test_other_keys_than_the_operations_are_refused(names: Any, types: Any) -> None:
    async with provided() as provider, client(provider.uri) as publisher:
        provider.open(SERVICE, MONITOR)
        with pytest.raises(MalError, match="parameter IDENTIFIER, asset LONG") as raised:
            await publisher._single(
                SERVICE, MONITOR, InteractionStage.PUBLISH_REGISTER, (names, types)
            )
        assert raised.value.number == StandardError.UNKNOWN.value


@pytest.mark.parametrize(
    "values",
    [
        None,
        (),
        (NullableAttribute(value=TypedAttribute(AttributeType.IDENTIFIER, "POS_X")),),
        (
            NullableAttribute(value=TypedAttribute(AttributeType.LONG, 7)),
            NullableAttribute(value=TypedAttribute(AttributeType.LONG, 7)),
        ),
    ],
)
async def test_key_values_that_do_not_fit_are_refused(values: Any) -> None:
    async with provided() as provider, client(provider.uri) as publisher:
        provider.open(SERVICE, MONITOR)
        await (publication := await publisher.publication(SERVICE, MONITOR)).publish(
            None, Rec(name="r", ok=True), keys=(None, None), domain=("esa",)
        )
        update = (UpdateHeader(keyValues=values), None, Rec(name="r", ok=True))
        publisher._send(
            SERVICE, MONITOR, InteractionStage.PUBLISH, update, number=publication._number
        )
        assert await refused(publication) == StandardError.UNKNOWN.value


async def test_publishers_are_bounded() -> None:
    async with provided(limits=PeerLimits(share=2)) as provider, client(provider.uri) as publisher:
        provider.open(SERVICE, MONITOR)
        numbers = []
        for name in ("a", "b", "a", "c"):
            publisher._own_uri = f"maltcp://h:1/{name}"
            try:
                await publisher.publication(SERVICE, MONITOR)
                numbers.append(0)
            except MalError as error:
                numbers.append(error.number)
        assert numbers == [0, 0, 0, StandardError.TOO_MANY.value]


@pytest.mark.parametrize(
    ("options", "status", "why"),
    [
        (["--droppable", "Vectors.doRequest"], 2, "Vectors.doRequest is none of Vectors.monitor"),
        (["--host", "192.0.2.1"], 2, "--clear-text"),
        (["--certificate", str(XML)], 2, "TLS needs all three files"),
        (["--host", "192.0.2.1", "--clear-text"], 1, "192.0.2.1:0"),
    ],
)
def test_a_broker_that_cannot_start_gives_the_reason(
    options: list[str], status: int, why: str
) -> None:
    result = CliRunner().invoke(main, [str(XML), *options])
    assert (result.exit_code, why in result.output) == (status, True)


def test_a_broker_wants_a_specification(tmp_path: Path) -> None:
    (tmp_path / "none.xml").write_text("<none/>")
    assert "no area" in CliRunner().invoke(main, [str(tmp_path / "none.xml")]).output
