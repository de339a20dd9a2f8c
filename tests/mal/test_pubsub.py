"""Publish and subscribe over real sockets: matching, loss of clients, clients that are too slow."""

import asyncio
from typing import Any

import pytest

from adapters.mal import (
    AttributeType,
    Connection,
    Consumer,
    EncodeError,
    Encoding,
    Header,
    InteractionStage,
    Keys,
    MalError,
    MalUri,
    PeerLimits,
    Publisher,
    StandardError,
    Subscription,
    SubscriptionFilter,
    TypedAttribute,
    UpdateHeader,
    connection,
    encode_message,
)
from adapters.mal.broker import domain_matches, matches
from adapters.mal.specification import REPLY
from tests.mal.wiretest import SERVICE, SPECIFICATION, Rec, connected, error_of, provided

MONITOR = "monitor"
REC = Rec(name="r", ok=True)


class Updates:
    """Collects updates, and waits for a number of them."""

    def __init__(self) -> None:
        self.seen: list[tuple[Any, ...]] = []
        self._arrived = asyncio.Event()

    def __call__(self, header: UpdateHeader, *parts: Any) -> None:
        self.seen.append((header, *parts))
        self._arrived.set()

    async def have(self, count: int) -> list[Any]:
        while len(self.seen) < count:
            self._arrived.clear()
            await self._arrived.wait()
        return [parts[1] and parts[1].value for parts in self.seen]


def publish(
    publisher: Publisher, value: float, name: str = "POS_X", droppable: bool = True
) -> None:
    publisher.publish(
        TypedAttribute(AttributeType.DOUBLE, value),
        REC,
        keys=(name, 7),
        domain=("esa", "rover1"),
        source="aboard",
        droppable=droppable,
    )


@pytest.mark.parametrize("encoding", list(Encoding))
async def test_updates_reach_their_subscribers(encoding: Encoding) -> None:
    async with (
        provided(encoding=encoding) as provider,
        connected(provider, encoding=encoding) as one,
        connected(provider, encoding=encoding) as two,
    ):
        publisher = provider.publisher(SERVICE, MONITOR)
        everything, some = Updates(), Updates()
        await one.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), everything)
        wanted = (TypedAttribute(AttributeType.IDENTIFIER, "HEAD"),)
        only_head = Subscription(
            subscriptionId="s",
            domain=("esa", "*"),
            selectedKeys=("asset",),
            filters=(SubscriptionFilter(name="parameter", values=wanted),),
        )
        await two.subscribe(SERVICE, MONITOR, only_head, some)
        for number, name in enumerate(("POS_X", "HEAD", "POS_Y", "HEAD")):
            publish(publisher, float(number), name)
        assert await everything.have(4) == [0.0, 1.0, 2.0, 3.0]
        assert await some.have(2) == [1.0, 3.0]
        header, value, rec = some.seen[0]
        assert (header.source, header.domain) == ("aboard", ("esa", "rover1"))
        assert [key.value for key in header.keyValues] == [TypedAttribute(AttributeType.LONG, 7)]
        assert value == TypedAttribute(AttributeType.DOUBLE, 1.0)
        assert rec == REC


async def test_a_subscription_is_replaced_and_ended() -> None:
    async with provided() as provider, connected(provider) as consumer:
        publisher = provider.publisher(SERVICE, MONITOR)
        first, second, other = Updates(), Updates(), Updates()
        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), first)
        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), second)
        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="o"), other)
        publish(publisher, 1.0)
        assert await second.have(1) == [1.0]
        await consumer.unsubscribe(SERVICE, MONITOR, "s")
        await consumer.unsubscribe(SERVICE, MONITOR, "never there")
        publish(publisher, 2.0)
        assert await other.have(2) == [1.0, 2.0]
        assert (len(first.seen), len(second.seen)) == (0, 1)


async def test_a_consumer_deregisters_before_it_hangs_up() -> None:
    operation = SPECIFICATION.operation(SERVICE, MONITOR)
    stages: asyncio.Queue[InteractionStage] = asyncio.Queue()

    def answer(connection: Connection, header: Header, _: bytes) -> None:
        stages.put_nowait(header.stage)
        connection.send(encode_message(header.reply(REPLY[header.stage], 0), b""))

    server = await asyncio.get_running_loop().create_server(
        lambda: Connection(answer), "127.0.0.1", 0
    )
    uri = MalUri("127.0.0.1", server.sockets[0].getsockname()[1], SERVICE)
    consumer = await Consumer.connect(SPECIFICATION, uri)
    for name in ("a", "b"):
        subscription = Subscription(subscriptionId=name)
        await consumer.subscribe(SERVICE, operation.name, subscription, Updates())
    await consumer.close()
    server.close()
    assert [stages.get_nowait() for _ in range(3)] == [
        InteractionStage.REGISTER,
        InteractionStage.REGISTER,
        InteractionStage.DEREGISTER,
    ]


async def test_nothing_is_registered_where_nothing_is_published() -> None:
    not_served = MalError(4)
    async with provided(not_served=not_served) as provider, connected(provider) as consumer:
        error = await error_of(
            consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), Updates())
        )
        assert error.number == 4


async def test_subscriptions_are_bounded() -> None:
    limits = PeerLimits(subscriptions=3, share=2)
    async with (
        provided(limits=limits) as provider,
        connected(provider) as greedy,
        connected(provider) as modest,
    ):
        provider.publisher(SERVICE, MONITOR)

        async def subscribe(consumer: Consumer, name: str) -> None:
            subscription = Subscription(subscriptionId=name)
            await consumer.subscribe(SERVICE, MONITOR, subscription, Updates())

        for name in ("a", "b", "b", "a"):
            await subscribe(greedy, name)
        error = await error_of(subscribe(greedy, "c"))
        assert str(error).endswith("TOO_MANY: at most 2 subscriptions over one connection")
        await subscribe(modest, "a")
        await greedy.unsubscribe(SERVICE, MONITOR, "a")
        await subscribe(greedy, "c")
        error = await error_of(subscribe(modest, "b"))
        assert str(error).endswith("at most 3 subscriptions over all connections together")
        async with connected(provider) as newcomer:
            await subscribe(newcomer, "a")
            await greedy.wait_lost()
        await modest.unsubscribe(SERVICE, MONITOR, "a")


@pytest.mark.parametrize(
    "large",
    [
        Subscription(subscriptionId="s" * 10_000),
        Subscription(subscriptionId="s", domain=("a",) * 1000),
        Subscription(subscriptionId="s", selectedKeys=("name",) * 1000),
        Subscription(
            subscriptionId="s",
            filters=(SubscriptionFilter(name="name", values=(None,) * 1000),),  # type: ignore[arg-type]
        ),
    ],
    ids=["id", "domain", "keys", "values"],
)
async def test_a_subscription_is_bounded(large: Subscription) -> None:
    async with provided() as provider, connected(provider) as consumer:
        provider.publisher(SERVICE, MONITOR)
        error = await error_of(consumer.subscribe(SERVICE, MONITOR, large, Updates()))
        assert error.number == StandardError.TOO_MANY.value


async def test_a_publication_must_fit_the_specification() -> None:
    async with provided() as provider, connected(provider) as consumer:
        publisher = provider.publisher(SERVICE, MONITOR)
        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), Updates())
        with pytest.raises(ValueError, match="argument"):
            publisher.publish(None, REC, keys=("POS_X",), domain=("esa",), droppable=True)
        with pytest.raises(EncodeError, match="rec: "):
            publisher.publish(None, None, keys=("a", 1), domain=("esa",), droppable=True)


async def test_notifications_carry_the_transaction_of_the_first_registration() -> None:
    async with provided() as provider:
        publisher = provider.publisher(SERVICE, MONITOR)
        arrived: asyncio.Queue[Header] = asyncio.Queue()
        connection = Connection(lambda _, header, _body: arrived.put_nowait(header))
        loop = asyncio.get_running_loop()
        uri = provider.uri.broker
        await loop.create_connection(lambda: connection, uri.host, uri.port)
        operation = SPECIFICATION.operation(SERVICE, MONITOR)
        for number, name in ((-5, b"a"), (6, b"b")):
            header = Header.of(
                operation,
                InteractionStage.REGISTER,
                number,
                from_uri="maltcp://h:1/MOE",
                to_uri=str(uri),
            )
            connection.send(encode_message(header, b"\0\0\0\1" + name + b"\0\0\0"))
            assert (await arrived.get()).transaction_id == number
        publish(publisher, 1.0)
        for _ in range(2):
            notification = await arrived.get()
            assert notification.stage is InteractionStage.NOTIFY
            assert notification.transaction_id == -5
            assert notification.from_uri == str(uri)
            assert notification.to_uri == "maltcp://h:1/MOE"
        await connection.close()


async def test_a_remote_publisher_is_refused() -> None:
    async with provided() as provider:
        provider.publisher(SERVICE, MONITOR)
        arrived: asyncio.Queue[tuple[Header, bytes]] = asyncio.Queue()
        connection = Connection(lambda _, header, body: arrived.put_nowait((header, body)))
        loop = asyncio.get_running_loop()
        uri = provider.uri.broker
        await loop.create_connection(lambda: connection, uri.host, uri.port)
        operation = SPECIFICATION.operation(SERVICE, MONITOR)
        for stage, answer, number in (
            (InteractionStage.PUBLISH_REGISTER, InteractionStage.PUBLISH_REGISTER_ACK, 65548),
            (InteractionStage.PUBLISH, InteractionStage.PUBLISH, 65552),
            (InteractionStage.PUBLISH_DEREGISTER, InteractionStage.PUBLISH_DEREGISTER_ACK, 65548),
        ):
            header = Header.of(operation, stage, 1, to_uri=str(uri))
            connection.send(encode_message(header, b""))
            reply, body = await arrived.get()
            assert (reply.stage, reply.is_error) == (answer, True)
            assert int.from_bytes(body[:4], "big") == number
        await connection.close()


async def test_a_lost_subscriber_is_forgotten_and_the_others_continue() -> None:
    async with provided() as provider, connected(provider) as stays:
        publisher = provider.publisher(SERVICE, MONITOR)
        updates = Updates()
        await stays.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), updates)
        goes = await Consumer.connect(SPECIFICATION, provider.uri)
        await goes.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), Updates())
        await goes.close()
        for number in range(100):
            publish(publisher, float(number))
            await asyncio.sleep(0)
        assert len(await updates.have(100)) == 100


@pytest.mark.parametrize("droppable", [True, False])
async def test_a_subscriber_that_does_not_read_loses_what_may_be_lost_or_the_connection(
    droppable: bool, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(connection, "BACKLOG_CAP", 100)
    big = Rec(name=20_000 * "x", ok=True)

    async with provided() as provider, connected(provider) as good:
        publisher = provider.publisher(SERVICE, MONITOR)
        received = Updates()
        await good.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="s"), received)
        reader, writer = await asyncio.open_connection(
            provider.uri.host, provider.uri.port, limit=1 << 10
        )
        operation = SPECIFICATION.operation(SERVICE, MONITOR)
        header = Header.of(operation, InteractionStage.REGISTER, 1, to_uri=str(provider.uri.broker))
        writer.write(encode_message(header, b"\0\0\0\1s\0\0\0"))
        await reader.readexactly(20)
        writer.transport.pause_reading()  # type: ignore[attr-defined]
        for number in range(1000):
            value = TypedAttribute(AttributeType.DOUBLE, float(number))
            publisher.publish(value, big, keys=("k", 1), domain=("esa",), droppable=droppable)
            await received.have(number + 1)
        assert ("queued messages may not be dropped" in caplog.text) is not droppable
        writer.close()


async def test_a_consumer_with_a_failing_handler_continues(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async with provided() as provider, connected(provider) as consumer:
        publisher = provider.publisher(SERVICE, MONITOR)
        updates = Updates()

        def breaks(*_: Any) -> None:
            raise ZeroDivisionError

        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="a"), breaks)
        await consumer.subscribe(SERVICE, MONITOR, Subscription(subscriptionId="b"), updates)
        publish(publisher, 1.0)
        assert await updates.have(1) == [1.0]
    assert "update of Vectors.monitor, subscription a" in caplog.text


def domain(text: str | None) -> tuple[str, ...] | None:
    return None if text is None else tuple(part for part in text.split(".") if part)


@pytest.mark.parametrize(
    ("wanted", "there", "match"),
    [
        (None, "esa.rover", True),
        (None, None, True),
        ("", "esa.rover", True),
        ("", None, False),
        ("esa", None, False),
        ("*", None, False),
        ("*", "esa.rover", True),
        ("*", "", True),
        ("esa.rover", "esa.rover", True),
        ("esa.rover", "esa.crane", False),
        ("esa.rover", "esa", False),
        ("esa", "esa.rover", False),
        ("esa.*", "esa", True),
        ("esa.*", "esa.rover.arm", True),
        ("esa.*", "nasa.rover", False),
        ("*.rover", "rover", True),
        ("*.rover", "esa.mars.rover", True),
        ("*.rover", "esa.rover.arm", False),
        ("esa.*.arm", "esa.rover.arm", True),
        ("esa.*.arm", "esa.arm", False),
        ("*.rover.*", "esa.rover.arm", True),
        ("*.rover.*", "rover", True),
        ("*.rover.*", "esa.crane", False),
        ("*.a.*.c.*", "x.a.b.c", True),
        ("*.a.*.c.*", "x.a.b.d", False),
        ("*.*", "", True),
    ],
)
def test_domains(wanted: str | None, there: str | None, match: bool) -> None:
    assert domain_matches(domain(wanted), domain(there)) is match


def identifier(value: str) -> TypedAttribute:
    return TypedAttribute(AttributeType.IDENTIFIER, value)


KEYS: Keys = {
    "parameter": identifier("POS_X"),
    "commandId": TypedAttribute(AttributeType.LONG, 7),
    "stage": TypedAttribute(AttributeType.UOCTET, 3),
    "source": None,
}


@pytest.mark.parametrize(
    ("filters", "match"),
    [
        (None, True),
        ({}, True),
        ({"parameter": []}, True),
        ({"parameter": [identifier("POS_X")]}, True),
        ({"parameter": [TypedAttribute(AttributeType.STRING, "POS_X")]}, True),
        ({"parameter": [identifier("POS_Y")]}, False),
        ({"parameter": [identifier("POS_Y"), identifier("POS_X")]}, True),
        ({"parameter": [identifier("*")]}, True),
        ({"source": [identifier("*")]}, True),
        ({"source": [identifier("MOE")]}, False),
        ({"source": [None]}, True),
        ({"parameter": [None]}, False),
        ({"commandId": [TypedAttribute(AttributeType.LONG, 7)]}, True),
        ({"commandId": [TypedAttribute(AttributeType.INTEGER, 7)]}, False),
        ({"commandId": [TypedAttribute(AttributeType.LONG, 8)]}, False),
        ({"commandId": [TypedAttribute(AttributeType.LONG, 0)]}, True),
        ({"stage": [TypedAttribute(AttributeType.UOCTET, 0)]}, False),
        ({"stage": [TypedAttribute(AttributeType.UOCTET, 3)]}, True),
        ({"colour": []}, False),
        (
            {
                "parameter": [identifier("POS_X")],
                "stage": [TypedAttribute(AttributeType.UOCTET, 4)],
            },
            False,
        ),
    ],
)
def test_filters(filters: dict[str, list[TypedAttribute]] | None, match: bool) -> None:
    subscription = Subscription(
        subscriptionId="s",
        filters=None
        if filters is None
        else tuple(SubscriptionFilter(name=n, values=tuple(v)) for n, v in filters.items()),
    )
    assert matches(subscription, ("esa",), KEYS) is match
