"""A client given one URI finds the rest: services and brokers where the directory says they are."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass

import pytest

from adapters.mal import CallContext, MalUri, Provider, ServiceId
from adapters.mrs.ground import MrsClient
from adapters.mrs.ground.rover_consumer import ServiceLocation, ServiceLocations, service_locations
from adapters.mrs.spec import (
    CameraState,
    Notification,
    ReceivedReport,
    ServiceDescriptor,
    mrs_specification,
)
from adapters.mrs.transport import TransportSettings
from executive.commands import Stop
from tests.mrs.aboard import event

REQUESTED = MalUri("tunnel", 5000, "MRS")
SELF = "maltcp://10.0.0.1:21000/MRS"
OTHER = "maltcp://10.0.0.2:42000/Other"


def descriptor(
    name: str, at: str, broker: str | None = None, listed_as: str = ""
) -> ServiceDescriptor:
    specification = mrs_specification()
    (service,) = (s for area in specification.areas for s in area.services if s.name == name)
    first = service.operations[0]
    return ServiceDescriptor(
        name=listed_as or name,
        service=ServiceId(
            keyArea=first.area, keyService=first.service, keyAreaVersion=first.area_version
        ),
        providerURI=at,
        brokerURI=broker,
        operations=(),
    )


DIRECTORY = descriptor("ServiceLayer", SELF)


@pytest.mark.parametrize(
    ("found", "locations"),
    [
        ((descriptor("Camera", SELF),), ServiceLocations()),
        ((descriptor("Camera", str(REQUESTED)),), ServiceLocations()),
        ((descriptor("Notification", SELF, f"{SELF}InternalBroker"),), ServiceLocations()),
        ((descriptor("Camera", OTHER),), ServiceLocations({"Camera": ServiceLocation(OTHER)})),
        (
            (descriptor("Plan", OTHER, f"{OTHER}InternalBroker"),),
            ServiceLocations({"Plan": ServiceLocation(OTHER)}, {"Plan": ServiceLocation(OTHER)}),
        ),
        (
            (descriptor("Monitoring", SELF, OTHER),),
            ServiceLocations({}, {"Monitoring": ServiceLocation(OTHER, is_broker=True)}),
        ),
        ((descriptor("Camera", OTHER, listed_as="husky.Camera"),), ServiceLocations()),
        ((descriptor("ServiceLayer", OTHER, listed_as="husky.ServiceLayer"),), ServiceLocations()),
        ((descriptor("Camera", OTHER, listed_as="MotionControl"),), ServiceLocations()),
        (
            (descriptor("Camera", "malspp:1/2/3"),),
            ServiceLocations({"Camera": ServiceLocation("malspp:1/2/3")}),
        ),
    ],
)
def test_sorts_the_entries_of_the_directory(
    found: tuple[ServiceDescriptor, ...], locations: ServiceLocations
) -> None:
    assert service_locations((DIRECTORY, *found), REQUESTED) == locations


@dataclass(slots=True)
class Parts:
    """A rover in parts: a directory, a camera, and a broker of its own for notifications."""

    directory: Provider
    camera: Provider
    broker: Provider

    def notify(self, sequence: int) -> None:
        publisher = self.broker.publisher("Notification", "monitorNotification")
        publisher.publish(
            event(sequence=sequence, cursor=sequence),
            keys=("parts", 1, 1, None, None),
            domain=("parts",),
            source="parts",
            droppable=False,
        )


def camera(pan_rad: float) -> Provider:
    state = CameraState(pan=pan_rad, tilt=0.0, rotateSpeed=1.0, videoOn=False)
    provider = Provider(mrs_specification(), "Camera")
    provider.serve("Camera", "getState", lambda _: (state,))
    return provider


@asynccontextmanager
async def in_parts() -> AsyncIterator[Parts]:
    parts = Parts(
        Provider(mrs_specification(), "MRS"), camera(0.5), Provider(mrs_specification(), "Broker")
    )
    parts.broker.publisher("Notification", "monitorNotification")
    for provider in (parts.directory, parts.camera, parts.broker):
        await provider.start()
    at = str(parts.directory.uri)
    services = (
        descriptor("ServiceLayer", at),
        descriptor("Camera", str(parts.camera.uri)),
        descriptor("Notification", at, str(parts.broker.uri)),
    )
    missed = (event(sequence=1, cursor=1), event(sequence=2, cursor=2))
    parts.directory.serve("ServiceLayer", "getServices", lambda _: (services,))

    def missed_since(_: CallContext, since: int, *__: object) -> tuple[tuple[Notification, ...]]:
        return (tuple(each for each in missed if each.sequence >= since),)

    parts.directory.serve("Notification", "getNotifications", missed_since)
    yield parts
    for provider in (parts.directory, parts.camera, parts.broker):
        await provider.close()


async def next_of(stream: AsyncIterator[ReceivedReport]) -> int:
    return (await asyncio.wait_for(anext(stream), 60.0)).report.sequence


@pytest.mark.parametrize("round_trip_s", [0.0, 1.0])
def test_calls_and_subscriptions_use_the_addresses_of_the_directory(round_trip_s: float) -> None:
    """On a link with a delay the first ones are sent before the directory is known."""
    terms = TransportSettings(round_trip_s=round_trip_s)

    async def scenario() -> None:
        async with (
            in_parts() as parts,
            await MrsClient.connect(str(parts.directory.uri), terms=terms) as client,
        ):
            stream = client.notifications()
            assert (await client.get_camera_state()).pan == 0.5
            parts.notify(1)
            assert await next_of(stream) == 1
            assert len(await client.get_services()) == 3

    asyncio.run(scenario())


def test_a_command_without_reports_of_its_end_is_not_waited_for() -> None:
    """On a link with a delay it is sent before the directory is known."""
    terms = TransportSettings(round_trip_s=1.0)

    async def scenario() -> None:
        rover = Provider(mrs_specification(), "MRS")
        await rover.start()
        services = tuple(descriptor(each, str(rover.uri)) for each in ("MotionControl", "Status"))
        rover.serve("ServiceLayer", "getServices", lambda _: (services,))
        rover.serve("MotionControl", "stop", lambda *_: None)
        async with await MrsClient.connect(str(rover.uri), terms=terms) as client:
            with pytest.raises(ConnectionError, match=r"accepted, but .* serve Notification"):
                await asyncio.wait_for(client.run(client.command(Stop())), 20.0)
        await rover.close()

    asyncio.run(scenario())


def test_a_restarted_service_is_found_again() -> None:
    async def scenario() -> None:
        async with in_parts() as parts, await MrsClient.connect(str(parts.directory.uri)) as client:
            stream = client.notifications()
            await client.get_camera_state()
            parts.notify(1)
            assert await next_of(stream) == 1
            await parts.camera.close()
            with pytest.raises(ConnectionError, match=f"Camera, listed at {parts.camera.uri}, is"):
                await client.get_camera_state()
            assert await next_of(stream) == 2  # missed meanwhile, by the directory's account
            parts.camera, port = camera(0.7), parts.camera.uri.port
            await parts.camera.start(port=port)
            assert (await client.get_camera_state()).pan == 0.7
            parts.notify(3)
            assert await next_of(stream) == 3

    asyncio.run(scenario())


def test_a_closed_broker_is_a_lost_link() -> None:
    async def scenario() -> None:
        async with in_parts() as parts:
            await parts.broker.close()
            with pytest.raises(
                ConnectionError, match=f"Notification, listed at {parts.broker.uri}"
            ):
                await MrsClient.connect(str(parts.directory.uri))

    asyncio.run(scenario())
