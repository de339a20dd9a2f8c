"""Others publish at a rover's broker as themselves, and as nobody else."""

from dataclasses import replace

import pytest

from adapters.mal import (
    AttributeType,
    Consumer,
    MalError,
    Publication,
    ServiceId,
    Subscription,
    Typed,
)
from adapters.mrs.spec.types import (
    Notification,
    NotificationKind,
    ParameterValue,
    ServiceDescriptor,
    Severity,
    Validity,
)
from tests.mrs.aboard import Aboard

INVALID, REJECTED = 1, 2
DOMAIN = ("meteron", "scout")
SCOUT = ServiceDescriptor(
    name="scout.ServiceLayer",
    service=ServiceId(keyArea=3001, keyService=1, keyAreaVersion=1),
    providerURI="maltcp://127.0.0.1:9/MRS",
    operations=(1, 5),
)
HEAD = ParameterValue(
    name="HEAD", timestamp=0, validity=Validity.VALID, value=Typed(AttributeType.DOUBLE, 1.5)
)
DUST = Notification(
    kind=NotificationKind.EVENT,
    severity=Severity.ALARM,
    timestamp=0,
    sequence=7,
    text="the lens is dusty",
)
DUST_KEYS = ("scout", 2, 3, None, None)


async def register(consumer: Consumer) -> tuple[Publication, Publication]:
    await consumer.submit("ServiceLayer", "registerService", SCOUT)
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


async def test_a_registered_asset_is_heard(consumer: Consumer) -> None:
    heard: list[tuple[str | None, object]] = []

    values, notifications = await register(consumer)
    everything = Subscription(subscriptionId="all", domain=DOMAIN)
    for name in (
        ("MonitoringClient", "monitorAssetValue"),
        ("NotificationClient", "monitorAssetNotification"),
    ):
        await consumer.subscribe(
            *name, everything, lambda update, part: heard.append((update.source, part))
        )
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    await notifications.publish(DUST, keys=DUST_KEYS, domain=DOMAIN, source="scout")
    found = await consumer.request("MonitoringClient", "getValue", "scout", ())
    assert found == ((HEAD,),)
    found = await consumer.request("NotificationClient", "getNotifications", "scout", None, 0)
    assert found == ((DUST,),)
    assert heard == [("scout", HEAD), ("scout", DUST)]


async def test_who_is_not_registered_over_this_connection_is_not(consumer: Consumer) -> None:
    values = await consumer.publication("MonitoringClient", "monitorAssetValue")
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    assert (await error_of(consumer, values)).number == REJECTED
    values, _ = await register(consumer)
    await values.publish(HEAD, keys=("jackal", "HEAD"), domain=DOMAIN, source="jackal")
    assert (await error_of(consumer, values)).number == REJECTED
    await consumer.submit("ServiceLayer", "deregisterService", SCOUT.name)
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
            replace(HEAD, value=Typed(AttributeType.DOUBLE, float("inf"))),
            ("scout", "HEAD"),
            "scout",
        ),
    ],
)
async def test_a_value_that_is_not_what_its_keys_say_is_invalid(
    value: ParameterValue,
    keys: tuple[object, ...],
    source: str | None,
    consumer: Consumer,
) -> None:
    values, _ = await register(consumer)
    await values.publish(value, keys=keys, domain=DOMAIN, source=source)
    assert (await error_of(consumer, values)).number == INVALID
    assert await consumer.request("MonitoringClient", "getValue", "scout", ()) == ((),)


@pytest.mark.parametrize(
    ("notification", "keys"),
    [
        (DUST, ("scout", 1, 3, None, None)),
        (DUST, ("scout", 2, 3, 4, None)),
        (replace(DUST, text="x" * 5000), DUST_KEYS),
    ],
)
async def test_a_notification_that_is_not_what_its_keys_say_is_invalid(
    notification: Notification, keys: tuple[object, ...], consumer: Consumer
) -> None:
    values, notifications = await register(consumer)
    await notifications.publish(notification, keys=keys, domain=DOMAIN, source="scout")
    await consumer.request("ServiceLayer", "getAsset")
    with pytest.raises(MalError) as raised:
        await notifications.publish(DUST, keys=DUST_KEYS, domain=DOMAIN, source="scout")
    assert raised.value.number == INVALID
    await values.publish(HEAD, keys=("scout", "HEAD"), domain=DOMAIN, source="scout")
    past = await consumer.request("NotificationClient", "getNotifications", "scout", None, 0)
    assert past == ((),)


async def test_a_liar_at_an_address_is_offline(aboard: Aboard, consumer: Consumer) -> None:
    """Who answers at the address of another by a name of its own is not taken for it."""

    lie = replace(SCOUT, providerURI=aboard.uri)
    await consumer.submit("ServiceLayer", "registerService", lie)
    (assets,) = await consumer.request("MonitoringClient", "listAssets")
    assert [(each.asset, each.mode.name) for each in assets] == [
        ("jackal", "IDLE"),
        ("scout", "OFFLINE"),
    ]
