"""What may be registered at a service layer: descriptors that make sense, each name once."""

import asyncio
from dataclasses import replace

import pytest

from adapters.mal import AttributeType, Consumer, MalError, ServiceId, Typed
from adapters.mrs.fleet import directory_service as registries
from adapters.mrs.fleet.directory_service import asset_of, is_valid_descriptor
from adapters.mrs.spec.errors import AreaError, describe_error
from adapters.mrs.spec.specification import mrs_specification
from adapters.mrs.spec.types import ServiceDescriptor
from tests.mrs.aboard import Aboard

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


async def test_what_is_registered_is_found_until_it_is_deregistered(consumer: Consumer) -> None:
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
    elsewhere = replace(MAP, providerURI="maltcp://192.0.2.8:5000/Maps")

    async def session(consumer: Consumer) -> None:
        holder = await Consumer.connect(mrs_specification(), aboard.uri)
        await holder.submit("ServiceLayer", "registerService", MAP)
        error = await refused(consumer, "registerService", elsewhere)
        assert (error.number, error.extra) == (DUPLICATE, Typed(AttributeType.STRING, "Map"))
        assert describe_error(error) == "Duplicate: Map"
        # it came back before its former connection was missed
        await consumer.submit("ServiceLayer", "registerService", replace(MAP, operations=(1,)))
        error = await refused(holder, "registerService", elsewhere)
        assert error.number == DUPLICATE
        await holder.close()

    aboard.consume(session)

    async def after(consumer: Consumer) -> None:
        await consumer.submit("ServiceLayer", "registerService", elsewhere)
        assert await consumer.request("ServiceLayer", "getService", "Map") == (elsewhere,)

    aboard.consume(after)


@pytest.mark.parametrize(
    "name", ["ServiceLayer", "ServiceLayer.above", "Camera", "jackal.ServiceLayer"]
)
async def test_what_is_served_here_keeps_its_name(name: str, consumer: Consumer) -> None:
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
    assert not is_valid_descriptor(strange)

    before = await consumer.request("ServiceLayer", "getServices")
    error = await refused(consumer, "registerService", strange)
    assert error.number == INVALID
    assert await consumer.request("ServiceLayer", "getServices") == before


def test_a_service_of_another_area_has_whatever_operations() -> None:
    assert is_valid_descriptor(MAP)
    assert is_valid_descriptor(
        replace(MAP, operations=(65535,), brokerURI="maltcp://[::1]:5001/Broker")
    )
    assert not is_valid_descriptor(replace(MAP, operations=(0,)))


def test_names_tell_whose_service_layer_it_is() -> None:
    assert asset_of(SCOUT) == "scout"
    assert asset_of(replace(SCOUT, name="a.b.ServiceLayer")) == "a.b"
    for name in ("ServiceLayer", ".ServiceLayer", "ServiceLayer.above", "scout.Camera"):
        assert asset_of(replace(SCOUT, name=name)) is None


async def test_so_many_and_no_more_but_who_is_gone_gives_way(
    aboard: Aboard, monkeypatch: pytest.MonkeyPatch, consumer: Consumer
) -> None:
    monkeypatch.setattr(registries, "MOST_SERVICES", 3)

    gone = await Consumer.connect(mrs_specification(), aboard.uri)
    await gone.submit("ServiceLayer", "registerService", replace(MAP, name="Gone"))
    for name in ("One", "Two"):
        await consumer.submit("ServiceLayer", "registerService", replace(MAP, name=name))
    error = await refused(consumer, "registerService", replace(MAP, name="Three"))
    assert error.number == TOO_MANY
    await gone.close()
    async with asyncio.timeout(60.0):
        while True:
            try:
                await consumer.submit("ServiceLayer", "registerService", replace(MAP, name="Three"))
            except MalError:
                continue
            break
    with pytest.raises(MalError) as raised:
        await consumer.request("ServiceLayer", "getService", "Gone")
    assert raised.value.number == AreaError.NOT_FOUND.value
