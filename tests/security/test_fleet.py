"""Attacks by who is connected: to speak as another asset, to send the rover elsewhere, to flood."""

import asyncio
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from adapters.mal import Consumer, MalError, ServiceId, StandardError, Subscription, UpdateHeader
from adapters.mrs.aboard.asset_services import ALL_EVENTS_HZ, EVENTS_HZ
from adapters.mrs.aboard.served_operations import MAX_PEERS, PeerRateLimiter
from adapters.mrs.fleet.directory_service import MAX_SERVICES_PER_PEER, asset_of
from adapters.mrs.spec import (
    AreaError,
    AssetInfo,
    AssetMode,
    ParameterValue,
    ServiceDescriptor,
    Severity,
    describe_error,
    mrs_specification,
)
from adapters.mrs.transport import TransportSettings
from tests.mrs.aboard import Aboard, event, reading
from tests.mrs.fleet import eventually, services, was_reported
from tests.support.certificates import certified

MOCUP = ServiceDescriptor(
    name="mocup.ServiceLayer",
    service=ServiceId(keyArea=3001, keyService=1, keyAreaVersion=1),
    providerURI="maltcp://127.0.0.1:9/MRS",
    operations=(1, 2, 5),
)
LAYER = "ServiceLayer"


async def error_of(consumer: Consumer, service: str, operation: str, *parts: object) -> MalError:
    with pytest.raises(MalError) as raised:
        await consumer.submit(service, operation, *parts)
    return raised.value


async def stranger(rover: Aboard, name: str = "") -> Consumer:
    tls = None if rover.terms.certificates is None else rover.terms.for_consumer()
    return await Consumer.connect(mrs_specification(), rover.uri, name or "stranger", tls=tls)


@contextmanager
def listening() -> Iterator[socket.socket]:
    """Give a port at another address of this computer, which nobody is to be sent to."""
    with socket.create_server(("127.0.0.2", 0)) as server:
        server.setblocking(False)
        yield server


def test_no_other_client_publishes_values_as_this_rover(aboard: Aboard) -> None:
    received: list[object] = []

    def on_value(update: UpdateHeader, _: ParameterValue) -> None:
        received.extend(key.value.value for key in (update.keyValues or ())[:1] if key.value)

    async def session(consumer: Consumer) -> None:
        everything = Subscription(subscriptionId="all")
        for service, operation in (
            ("Monitoring", "monitorValue"),
            ("MonitoringClient", "monitorAssetValue"),
        ):
            await consumer.subscribe(service, operation, everything, on_value)
        flat = (reading("BATERY_VOLTAGE", 3.0),)
        error = await error_of(consumer, "Monitoring", "publishParameters", flat)
        assert error.number == AreaError.REJECTED.value
        assert "register NAME.ServiceLayer over this connection first" in describe_error(error)
        await consumer.submit(LAYER, "registerService", MOCUP)
        await consumer.submit("Monitoring", "publishParameters", flat)
        (own,) = await consumer.request("Monitoring", "getValue", ("BATERY_VOLTAGE",))
        assert own != flat
        assert await consumer.request("MonitoringClient", "getValue", "mocup", ()) == (flat,)

    aboard.consume(session)
    assert received == ["mocup"]


@pytest.mark.parametrize(
    "value",
    [
        reading("HEAD", float("inf")),
        reading("two words", 1.0),
        replace(reading("HEAD", None), validity=reading("HEAD").validity),
    ],
)
def test_values_that_are_nonsense_are_named(aboard: Aboard, value: ParameterValue) -> None:
    async def session(consumer: Consumer) -> None:
        await consumer.submit(LAYER, "registerService", MOCUP)
        good = reading("HEAD", 1.0)
        error = await error_of(consumer, "Monitoring", "publishParameters", (good, value))
        assert describe_error(error).startswith(f"Invalid: values: {value.name} must be a VALID")
        assert await consumer.request("MonitoringClient", "getValue", "mocup", ()) == ((),)

    aboard.consume(session)


def test_a_certificate_registers_under_its_own_name_only(tmp_path: Path) -> None:
    ends = certified(tmp_path, "jackal", "mocup", "mallory")
    rover = Aboard(tmp_path / "jackal", terms=TransportSettings(certificates=ends["jackal"]))

    async def session() -> None:
        mallory, mocup = [
            await Consumer.connect(
                mrs_specification(),
                rover.uri,
                name,
                tls=TransportSettings(certificates=ends[name]).for_consumer(),
            )
            for name in ("mallory", "mocup")
        ]
        error = await error_of(mallory, LAYER, "registerService", MOCUP)
        assert error.number == AreaError.REJECTED.value
        assert "the certificate has the name mallory" in describe_error(error)
        await mocup.submit(LAYER, "registerService", MOCUP)
        for operation, part in (("registerService", MOCUP), ("deregisterService", MOCUP.name)):
            error = await error_of(mallory, LAYER, operation, part)
            assert error.number == AreaError.REJECTED.value
        assert await mocup.request(LAYER, "getService", MOCUP.name) == (MOCUP,)
        await mallory.close()
        await mocup.close()

    try:
        asyncio.run(session())
    finally:
        rover.close()


def test_a_rover_with_the_certificate_of_another_receives_the_reason_of_its_refusal(
    tmp_path: Path,
) -> None:
    ends = certified(tmp_path, "jackal", "husky")
    jackal = Aboard(tmp_path / "jackal", terms=TransportSettings(certificates=ends["jackal"]))
    terms = TransportSettings(certificates=ends["husky"])
    scout = Aboard(tmp_path / "scout", terms=terms, asset="scout", service_layer=jackal.uri)
    try:
        eventually(
            lambda: was_reported(scout, "scout.ServiceLayer: the certificate has the name husky")
        )
        assert "scout.ServiceLayer" not in services(jackal)
    finally:
        scout.close()
        jackal.close()


def test_a_name_is_free_when_its_holder_hangs_up(aboard: Aboard) -> None:
    other = replace(MOCUP, providerURI="maltcp://127.0.0.1:10/MRS")

    async def session(consumer: Consumer) -> None:
        squatter = await stranger(aboard)
        await squatter.submit(LAYER, "registerService", MOCUP)
        error = await error_of(consumer, LAYER, "registerService", other)
        assert error.number == AreaError.DUPLICATE.value
        await squatter.close()
        async with asyncio.timeout(10.0):
            while True:
                try:
                    await consumer.submit(LAYER, "registerService", other)
                    break
                except MalError:
                    await asyncio.sleep(0)

    aboard.consume(session)


def test_one_peer_does_not_use_the_capacity_of_all(aboard: Aboard) -> None:
    async def session(consumer: Consumer) -> None:
        for number in range(MAX_SERVICES_PER_PEER):
            name = f"swarm{number}.ServiceLayer"
            await consumer.submit(LAYER, "registerService", replace(MOCUP, name=name))
        error = await error_of(consumer, LAYER, "registerService", MOCUP)
        assert error.number == StandardError.TOO_MANY.value
        assert f"{MAX_SERVICES_PER_PEER} registered services of one peer" in describe_error(error)
        await consumer.submit(LAYER, "deregisterService", "swarm0.ServiceLayer")
        await consumer.submit(LAYER, "registerService", MOCUP)

    aboard.consume(session)


def test_the_rover_is_sent_to_no_other_computer(aboard: Aboard) -> None:
    async def session(consumer: Consumer) -> tuple[AssetInfo, ...]:
        host, port = victim.getsockname()
        sent = replace(MOCUP, providerURI=f"maltcp://{host}:{port}/MRS")
        await consumer.submit(LAYER, "registerService", sent)
        (listed,) = await consumer.request(LAYER, "getService", MOCUP.name)
        assert asset_of(listed) == "mocup"
        assert listed.providerURI == f"maltcp://127.0.0.1:{port}/MRS", "where it is itself"
        found: tuple[AssetInfo, ...]
        (found,) = await consumer.request("MonitoringClient", "listAssets")
        return found

    with listening() as victim:
        found = aboard.consume(session)
        with pytest.raises(BlockingIOError):
            victim.accept()
    assert {each.asset: each.mode for each in found}["mocup"] is AssetMode.OFFLINE


def test_events_of_others_are_bounded_and_name_their_sender(aboard: Aboard) -> None:
    async def session(consumer: Consumer) -> list[MalError]:
        refused = []
        for _ in range(5 * EVENTS_HZ):
            forged = event(severity=Severity.CRITICAL, text="MOE:1 EXECUTED")
            try:
                await consumer.submit("Notification", "sendNotification", forged)
            except MalError as error:
                refused.append(error)
        return refused

    refused = aboard.consume(session)
    reported = [report.text for report in aboard.do(lambda bench: bench.received.reports)]
    assert 4 * EVENTS_HZ >= len(refused) >= 3 * EVENTS_HZ
    assert {error.number for error in refused} == {StandardError.TOO_MANY.value}
    assert f"at most {EVENTS_HZ} a second of 127.0.0.1" in str(refused[0])
    assert len(reported) + len(refused) == 5 * EVENTS_HZ
    assert set(reported) == {"127.0.0.1: MOE:1 EXECUTED"}


def test_a_peer_with_many_events_does_not_block_others() -> None:
    now_s = 0.0
    rate = PeerRateLimiter(EVENTS_HZ, lambda: now_s)

    def reported(peer: str) -> int:
        count = 0
        for _ in range(100):
            try:
                rate.admit(peer)
                count += 1
            except MalError:
                continue
        return count

    assert reported("loud") == EVENTS_HZ
    assert reported("calm") == EVENTS_HZ
    now_s = 0.5
    assert reported("loud") == EVENTS_HZ // 2
    now_s = 100.0
    assert reported("loud") == EVENTS_HZ
    assert sum(reported(str(peer)) for peer in range(MAX_PEERS)) == MAX_PEERS * EVENTS_HZ
    assert ALL_EVENTS_HZ < 100
