"""What may be registered at a service layer, and who publishes there as whom."""

import asyncio
from dataclasses import replace

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    Publication,
    ServiceId,
    Subscription,
    TypedAttribute,
)
from adapters.mrs.fleet import directory_service as registries
from adapters.mrs.fleet.directory_service import asset_of, descriptor_fault
from adapters.mrs.spec import (
    AreaError,
    Notification,
    ParameterValue,
    ServiceDescriptor,
    describe_error,
    mrs_specification,
)
from tests.mrs.aboard import Aboard, event, raises, reading

INVALID, DUPLICATE, NOT_FOUND, TOO_MANY = 1, 3, 5, 65553
MRS = 3001
MAP = ServiceDescriptor(
    name="Map",
    service=ServiceId(keyArea=200, keyService=1, keyAreaVersion=1),
    providerURI="maltcp://192.0.2.7:5000/Maps",
    operations=(1, 2),
)
SCOUT = ServiceDescriptor(
    name="scout.ServiceLayer",
    service=ServiceId(keyArea=MRS, keyService=1, keyAreaVersion=1),
    providerURI="maltcp://127.0.0.1:5000/MRS",
    operations=(1, 2, 5),
)


def service(area: int, number: int, version: int = 1) -> ServiceId:
    return ServiceId(keyArea=area, keyService=number, keyAreaVersion=version)


async def refused(consumer: Consumer, operation: str, part: object) -> MalError:
    with pytest.raises(MalError) as raised:
        await consumer.submit("ServiceLayer", operation, part)
    return raised.value


async def test_a_registered_service_is_found_until_it_is_deregistered(consumer: Consumer) -> None:
    await consumer.submit("ServiceLayer", "registerService", MAP)
    (services,) = await consumer.request("ServiceLayer", "getServices")
    assert MAP in services
    assert await consumer.request("ServiceLayer", "getService", "Map") == (MAP,)
    await consumer.submit("ServiceLayer", "deregisterService", "Map")
    with pytest.raises(MalError):
        await consumer.request("ServiceLayer", "getService", "Map")
    error = await refused(consumer, "deregisterService", "Map")
    assert (error.number, error.extra.value) == (NOT_FOUND, "Map")


def test_a_name_is_held_while_its_holder_is_there(aboard: Aboard) -> None:
    other = replace(MAP, providerURI="maltcp://192.0.2.8:5000/Maps")

    async def session(consumer: Consumer) -> None:
        holder = await Consumer.connect(mrs_specification(), aboard.uri)
        await holder.submit("ServiceLayer", "registerService", MAP)
        error = await refused(consumer, "registerService", other)
        assert (error.number, error.extra) == (
            DUPLICATE,
            TypedAttribute(AttributeType.STRING, "Map"),
        )
        assert describe_error(error) == "Duplicate: Map"
        # it came back before its former connection was missed
        await consumer.submit("ServiceLayer", "registerService", replace(MAP, operations=(1,)))
        error = await refused(holder, "registerService", other)
        assert error.number == DUPLICATE
        await holder.close()

    aboard.consume(session)

    async def after(consumer: Consumer) -> None:
        await consumer.submit("ServiceLayer", "registerService", other)
        assert await consumer.request("ServiceLayer", "getService", "Map") == (other,)

    aboard.consume(after)


@pytest.mark.parametrize(
    "name", ["ServiceLayer", "ServiceLayer.above", "Camera", "jackal.ServiceLayer"]
)
async def test_a_local_service_retains_its_name(name: str, consumer: Consumer) -> None:
    number = 7 if name == "Camera" else 1
    double = replace(SCOUT, name=name, service=service(MRS, number))

    assert (await refused(consumer, "registerService", double)).number == DUPLICATE
    error = await refused(consumer, "deregisterService", name)
    assert error.number == NOT_FOUND


@pytest.mark.parametrize(
    "changes",
    [
        {"name": ""},
        {"name": "two words"},
        {"name": "bell\a"},
        {"name": "x" * 65},
        {"name": "scout.Camera"},
        {"name": "Camera2"},
        {"providerURI": ""},
        {"providerURI": "maltcp://scout/MRS"},
        {"providerURI": "maltcp://scout:0/MRS"},
        {"providerURI": "maltcp://scout:99999/MRS"},
        {"providerURI": "maltcp://[scout:5/MRS"},
        {"providerURI": "http://scout:5000/MRS"},
        {"providerURI": "maltcp://scout:5000/" + "x" * 300},
        {"brokerURI": "somewhere"},
        {"operations": ()},
        {"operations": (1, 1)},
        {"operations": (6,)},
        {"operations": (0,)},
        {"operations": tuple(range(1, 400))},
        {"service": service(MRS, 99)},
        {"service": service(MRS, 1, version=2)},
        {"service": service(200, 1)},
        {"service": service(0, 0, 0)},
    ],
)
async def test_a_descriptor_that_makes_no_sense_is_invalid(
    changes: dict[str, object], consumer: Consumer
) -> None:
    strange = replace(SCOUT, **changes)  # type: ignore[arg-type]
    assert descriptor_fault(strange)

    before = await consumer.request("ServiceLayer", "getServices")
    error = await refused(consumer, "registerService", strange)
    assert error.number == INVALID
    assert await consumer.request("ServiceLayer", "getServices") == before


def test_a_service_of_another_area_has_any_operations() -> None:
    assert descriptor_fault(MAP) is None
    other = replace(MAP, operations=(65535,), brokerURI="maltcp://[::1]:5001/Broker")
    assert descriptor_fault(other) is None
    assert descriptor_fault(replace(MAP, operations=(0,)))


def test_names_identify_the_service_layer() -> None:
    assert asset_of(SCOUT) == "scout"
    assert asset_of(replace(SCOUT, name="a.b.ServiceLayer")) == "a.b"
    for name in ("ServiceLayer", ".ServiceLayer", "ServiceLayer.above", "scout.Camera"):
        assert asset_of(replace(SCOUT, name=name)) is None


async def test_the_directory_is_bounded_and_closed_providers_are_replaced(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, consumer: Consumer
) -> None:
    monkeypatch.setattr(registries, "MAX_SERVICES", 3)

    closed = await Consumer.connect(mrs_specification(), aboard.uri)
    await closed.submit("ServiceLayer", "registerService", replace(MAP, name="Gone"))
    for name in ("One", "Two"):
        await consumer.submit("ServiceLayer", "registerService", replace(MAP, name=name))
    error = await refused(consumer, "registerService", replace(MAP, name="Three"))
    assert error.number == TOO_MANY
    await closed.close()
    async with asyncio.timeout(60.0):
        while True:
            try:
                await consumer.submit("ServiceLayer", "registerService", replace(MAP, name="Three"))
            except MalError:
                continue
            break
    with raises(AreaError.NOT_FOUND.value):
        await consumer.request("ServiceLayer", "getService", "Gone")


NOT_VALID, REJECTED = 1, 2
DOMAIN = ("meteron", "scout")
PUBLISHER = ServiceDescriptor(
    name="scout.ServiceLayer",
    service=ServiceId(keyArea=3001, keyService=1, keyAreaVersion=1),
    providerURI="maltcp://127.0.0.1:9/MRS",
    operations=(1, 5),
)
HEAD = reading("HEAD", 1.5)
DUST = event(sequence=7)
DUST_KEYS = ("scout", 2, 3, None, None)


async def register(consumer: Consumer) -> tuple[Publication, Publication]:
    await consumer.submit("ServiceLayer", "registerService", PUBLISHER)
    return (
        await consumer.publication("MonitoringClient", "monitorAssetValue"),
        await consumer.publication("NotificationClient", "monitorAssetNotification"),
    )


async def error_of(consumer: Consumer, publication: Publication) -> MalError:
    """Return what the broker said to the last publication; it says so before the next answer."""
    await consumer.request("ServiceLayer", "getAsset")
    with pytest.raises(MalError) as raised:
        await publication.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    return raised.value


async def test_a_registered_asset_is_received(consumer: Consumer) -> None:
    received: list[tuple[str | None, object]] = []

    values, notifications = await register(consumer)
    everything = Subscription(subscriptionId="all", domain=DOMAIN)
    for name in (
        ("MonitoringClient", "monitorAssetValue"),
        ("NotificationClient", "monitorAssetNotification"),
    ):
        await consumer.subscribe(
            *name, everything, lambda update, part: received.append((update.source, part))
        )
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    await notifications.publish(DUST, keys=DUST_KEYS, domain=DOMAIN, source="scout")
    found = await consumer.request("MonitoringClient", "getValue", "scout", ())
    assert found == ((HEAD,),)
    found = await consumer.request("NotificationClient", "getNotifications", "scout", None, 0)
    assert found == ((DUST,),)
    assert received == [("scout", HEAD), ("scout", DUST)]


async def test_an_asset_not_registered_over_this_connection_is_ignored(consumer: Consumer) -> None:
    values = await consumer.publication("MonitoringClient", "monitorAssetValue")
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    assert (await error_of(consumer, values)).number == REJECTED
    values, _ = await register(consumer)
    await values.publish(HEAD, keys=("jackal", "HEAD"), domain=DOMAIN, source="jackal")
    assert (await error_of(consumer, values)).number == REJECTED
    await consumer.submit("ServiceLayer", "deregisterService", PUBLISHER.name)
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    assert (await error_of(consumer, values)).number == REJECTED
    assert await consumer.request("MonitoringClient", "getValue", "scout", ()) == ((),)


@pytest.mark.parametrize(
    ("value", "keys", "source"),
    [
        (HEAD, ("scout", "HEAD"), "jackal"),
        (HEAD, ("scout", "HEAD"), None),
        (HEAD, (None, "HEAD"), None),
        (HEAD, ("scout", "POS_X"), "scout"),
        (HEAD, ("scout", None), "scout"),
        (replace(HEAD, name="no name"), ("scout", "no name"), "scout"),
        (
            replace(HEAD, value=TypedAttribute(AttributeType.DOUBLE, float("inf"))),
            ("scout", "HEAD"),
            "scout",
        ),
    ],
)
async def test_a_value_that_contradicts_its_keys_is_invalid(
    value: ParameterValue, keys: tuple[object, ...], source: str | None, consumer: Consumer
) -> None:
    values, _ = await register(consumer)
    await values.publish(value, keys=keys, domain=DOMAIN, source=source)
    assert (await error_of(consumer, values)).number == NOT_VALID
    assert await consumer.request("MonitoringClient", "getValue", "scout", ()) == ((),)


@pytest.mark.parametrize(
    ("notification", "keys"),
    [
        (DUST, ("scout", 1, 3, None, None)),
        (DUST, ("scout", 2, 3, 4, None)),
        (replace(DUST, text="x" * 5000), DUST_KEYS),
    ],
)
async def test_a_notification_that_contradicts_its_keys_is_invalid(
    notification: Notification, keys: tuple[object, ...], consumer: Consumer
) -> None:
    values, notifications = await register(consumer)
    await notifications.publish(notification, keys=keys, domain=DOMAIN, source="scout")
    await consumer.request("ServiceLayer", "getAsset")
    with raises(NOT_VALID):
        await notifications.publish(DUST, keys=DUST_KEYS, domain=DOMAIN, source="scout")
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    past = await consumer.request("NotificationClient", "getNotifications", "scout", None, 0)
    assert past == ((),)


async def test_a_liar_at_an_address_is_offline(aboard: Aboard, consumer: Consumer) -> None:
    """Who answers at the address of another by a name of its own is not taken for it."""

    lie = replace(PUBLISHER, providerURI=aboard.uri)
    await consumer.submit("ServiceLayer", "registerService", lie)
    (assets,) = await consumer.request("MonitoringClient", "listAssets")
    assert [(each.asset, each.mode.name) for each in assets] == [
        ("jackal", "IDLE"),
        ("scout", "OFFLINE"),
    ]
