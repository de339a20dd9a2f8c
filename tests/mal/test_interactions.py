"""SUBMIT and REQUEST between a provider and consumers over real sockets."""

import asyncio
import threading
from typing import Any

import pytest

from adapters.mal import (
    AttributeType,
    CallContext,
    Consumer,
    EncodeError,
    Encoding,
    MalError,
    MalUri,
    NamedValue,
    StandardError,
    TypedAttribute,
    TypedList,
)
from tests.mal.wiretest import SERVICE, SPECIFICATION, Rec, connected, error_of, provided


@pytest.mark.parametrize("encoding", list(Encoding))
async def test_parts_go_there_and_back(encoding: Encoding) -> None:
    submitted = []

    def submit(call: CallContext, name: str, on: bool) -> None:
        submitted.append((call, name, on))

    def echo(_: CallContext, value: Any, other: Any) -> tuple[Any, ...]:
        return value, other

    async with provided(encoding=encoding) as provider:
        provider.serve(SERVICE, "doSubmit", submit)
        provider.serve(SERVICE, "rec", echo)
        async with connected(provider, name="MOE", encoding=encoding) as consumer:
            prio = NamedValue(name="prio", value=TypedAttribute(AttributeType.UOCTET, 3))
            nil = NamedValue(name="nil")
            await consumer.submit(SERVICE, "doSubmit", "lamp", True, supplements=(prio, nil))
            rec = Rec(name="r", ok=True, any=TypedAttribute(AttributeType.LONG, 5))
            assert await consumer.request(SERVICE, "rec", rec, None) == (rec, None)
    ((call, *parts),) = submitted
    assert parts == ["lamp", True]
    assert (call.service, call.operation) == (SERVICE, "doSubmit")
    assert call.supplements == (prio, nil)
    assert call.from_uri is not None
    assert MalUri.parse(call.from_uri).name == "MOE"
    assert call.transaction_id > 0


async def test_errors_are_returned_with_number_and_extra() -> None:
    def fail(_: CallContext, code: int, text: str | None) -> None:
        raise MalError(code, text and TypedAttribute(AttributeType.STRING, text))

    def indices(*_: Any) -> None:
        raise MalError(3, TypedList(AttributeType.UINTEGER, (0, 3)))

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "fail", fail)
        provider.serve(SERVICE, "doSubmit", indices)
        error = await error_of(consumer.request(SERVICE, "fail", 70001, "battery low"))
        assert (error.number, str(error)) == (70001, "MAL error 70001: battery low")
        error = await error_of(consumer.request(SERVICE, "fail", 65551, None))
        assert str(error) == "MAL error 65551 UNKNOWN"
        error = await error_of(consumer.submit(SERVICE, "doSubmit", "x", True))
        assert error.extra == TypedList(AttributeType.UINTEGER, (0, 3))


async def test_a_reply_may_be_sent_later_and_from_another_thread() -> None:
    loop = asyncio.get_running_loop()
    proceed = threading.Event()

    def from_a_thread(*_: Any) -> asyncio.Future[Any]:
        future = loop.create_future()

        def answer() -> None:
            proceed.wait()
            loop.call_soon_threadsafe(future.set_result, ("later",))

        threading.Thread(target=answer).start()
        return future

    async def from_a_coroutine(*_: Any) -> None:
        await asyncio.sleep(0)
        raise MalError(StandardError.UNKNOWN)

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doRequest", from_a_thread)
        provider.serve(SERVICE, "doSubmit", from_a_coroutine)
        request = asyncio.create_task(consumer.request(SERVICE, "doRequest", 1.0))
        error = await error_of(consumer.submit(SERVICE, "doSubmit", "x", True))
        assert error.number == StandardError.UNKNOWN.value
        assert not request.done()
        proceed.set()
        assert await request == ("later",)


async def test_an_unserved_operation_gets_the_chosen_answer() -> None:
    not_served = MalError(4, TypedAttribute(AttributeType.STRING, "not here"))
    async with provided(not_served=not_served) as provider, connected(provider) as consumer:
        for interaction in (
            consumer.submit(SERVICE, "doSubmit", "x", True),
            consumer.request(SERVICE, "doRequest", 1.0),
        ):
            error = await error_of(interaction)
            assert (error.number, error.extra) == (not_served.number, not_served.extra)
    async with provided() as provider, connected(provider) as consumer:
        error = await error_of(consumer.request(SERVICE, "doRequest", 1.0))
        assert error.number == StandardError.UNSUPPORTED_OPERATION.value


async def test_a_repeatedly_given_answer_holds_nothing_of_its_caller() -> None:
    not_served = MalError(4)
    async with provided(not_served=not_served) as provider, connected(provider) as consumer:
        for _ in range(2):
            with pytest.raises(MalError):
                await consumer.request(SERVICE, "doRequest", 1.0)
    assert not_served.__traceback__ is None


async def test_a_handler_that_breaks_is_answered_for(caplog: pytest.LogCaptureFixture) -> None:
    def breaks(*_: Any) -> None:
        raise ZeroDivisionError

    async def breaks_later(*_: Any) -> None:
        raise ZeroDivisionError

    def answers_wrong(*_: Any) -> tuple[Any, ...]:
        return (1,)

    async with provided() as provider, connected(provider) as consumer:
        provider.serve(SERVICE, "doRequest", breaks)
        provider.serve(SERVICE, "echoLong", breaks_later)
        provider.serve(SERVICE, "echoShort", answers_wrong)
        for interaction in (
            consumer.request(SERVICE, "doRequest", 1.0),
            consumer.request(SERVICE, "echoLong", 1, None),
            consumer.request(SERVICE, "echoShort", 1, None),
        ):
            error = await error_of(interaction)
            assert error.number == StandardError.INTERNAL.value
    assert "ZeroDivisionError" in caplog.text
    assert "2 parts expected, 1 given" in caplog.text


async def test_only_what_can_be_served_may_be() -> None:
    async with provided() as provider:
        with pytest.raises(KeyError):
            provider.serve(SERVICE, "fly", lambda *_: None)
        with pytest.raises(ValueError, match="is a PUBSUB"):
            provider.serve(SERVICE, "monitor", lambda *_: None)
        with pytest.raises(ValueError, match="not a PUBSUB"):
            provider.publisher(SERVICE, "doRequest")


async def test_the_consumer_refuses_a_message_that_it_cannot_send() -> None:
    async with provided() as provider, connected(provider) as consumer:
        with pytest.raises(EncodeError, match=r"^d: "):
            await consumer.request(SERVICE, "doRequest", "fast")
        with pytest.raises(ValueError, match="is a REQUEST, not a SUBMIT"):
            await consumer.submit(SERVICE, "doRequest", 1.0)


async def test_no_answer_is_an_error_and_a_late_one_is_nothing() -> None:
    late: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
    async with provided() as provider, connected(provider, timeout_s=0.05) as consumer:
        provider.serve(SERVICE, "doRequest", lambda *_: late)
        provider.serve(SERVICE, "echoLong", lambda _, value, other: (value, other))
        error = await error_of(consumer.request(SERVICE, "doRequest", 1.0))
        assert error.number == StandardError.DELIVERY_TIMEDOUT.value
        late.set_result(("too late",))
        assert await consumer.request(SERVICE, "echoLong", 1, 2) == (1, 2)


async def test_an_absent_provider_is_an_error() -> None:
    async with provided() as provider:
        uri = str(provider.uri)
    error = await error_of(Consumer.connect(SPECIFICATION, uri))
    assert error.number == StandardError.DESTINATION_TRANSIENT.value
    for wrong in ("http://127.0.0.1:1/x", "maltcp://127.0.0.1/x", "maltcp://127.0.0.1:1/"):
        with pytest.raises(ValueError, match="maltcp://host:port/name"):
            await Consumer.connect(SPECIFICATION, wrong)


async def test_another_name_at_the_address_is_unknown() -> None:
    async with provided() as provider:
        other = MalUri(provider.uri.host, provider.uri.port, "Elsewhere")
        consumer = await Consumer.connect(SPECIFICATION, other)
        error = await error_of(consumer.request(SERVICE, "doRequest", 1.0))
        assert error.number == StandardError.DESTINATION_UNKNOWN.value
        await consumer.close()
