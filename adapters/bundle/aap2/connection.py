"""One connection to a uD3TN daemon: dialled, greeted and configured; everything of ud3tn-utils."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from typing import Any, Final

from google.protobuf.message import DecodeError
from ud3tn_utils.aap2 import (
    AAP2AsyncClient,
    AAP2AsyncTCPClient,
    AAP2AsyncUnixClient,
    AAP2Error,
    AAP2OperationFailed,
    AAPMessage,
    BundleADU,
    BundleADUFlags,
    Keepalive,
    ResponseStatus,
)

from adapters.bundle.codec.bundle import Creation
from adapters.bundle.codec.eid import (
    Dtn,
    Eid,
    Ipn,
    node_of,
    parse_eid,
)
from adapters.bundle.codec.errors import BundleError
from adapters.bundle.daemons.link import Inbound, Outbound
from adapters.bundle.node.settings import Aap2Settings

BROKEN: Final = (OSError, EOFError, AAP2Error, DecodeError)
"""What the client raises when a connection is over or what comes makes no sense."""

_ALIVE: Final = ResponseStatus.RESPONSE_STATUS_ACK
_TAKEN: Final = ResponseStatus.RESPONSE_STATUS_SUCCESS
_NO_DATA: Final = {
    BundleADUFlags.BUNDLE_ADU_STATUS_REPORT,
    BundleADUFlags.BUNDLE_ADU_BPDU,
}


class Connection:
    """A connection for an endpoint, to send from it or to receive at it."""

    def __init__(self, client: AAP2AsyncClient, settings: Aap2Settings) -> None:
        """Use a client that is configured; see `dial`."""
        self._client, self._settings = client, settings

    async def send(self, data: Outbound) -> str | None:
        """Hand something over; return None if the daemon has it, or what it answered."""
        adu = BundleADU(
            dst_eid=str(data.destination),
            payload_length=len(data.payload),
            adu_flags=[BundleADUFlags.BUNDLE_ADU_NORMAL],
        )
        async with asyncio.timeout(self._settings.answer_s):
            response = await self._client.send_adu_rpc(adu, data.payload)
        return self._failure(response.response_status)

    async def stay_alive(self) -> None:
        """Say that this side is there."""
        async with asyncio.timeout(self._settings.answer_s):
            await self._client.send_rpc(AAPMessage(keepalive=Keepalive()))

    async def receive(self, most_octets: int) -> Inbound | None:
        """Wait for what comes next; None for what is no application data.

        Raises:
            AAP2Error: it is longer than that.
        """
        async with asyncio.timeout(2 * self._settings.keepalive_s):
            message = await self._client.receive_msg()
            kind = message.WhichOneof("msg")
            if kind == "keepalive":
                await self._client.send_response_status(_ALIVE)
            if kind != "adu":
                return None
            if message.adu.payload_length > most_octets:
                raise AAP2Error(f"{message.adu.payload_length} octets from {message.adu.src_eid}")
            adu, payload = await self._client.receive_adu(message.adu)
        inbound = None if _NO_DATA.intersection(adu.adu_flags) else _inbound(adu, payload)
        if inbound is None:
            await self.taken()
        return inbound

    async def taken(self) -> None:
        """Say that what came last is on the disk."""
        await self._client.send_response_status(_TAKEN)

    def _failure(self, status: Any) -> str | None:
        return None if status == _TAKEN else f"uD3TN: {self._client.response_status_name(status)}"


@asynccontextmanager
async def dial(
    settings: Aap2Settings, own: Eid, secret: str, *, subscribe: bool
) -> AsyncIterator[Connection]:
    """Connect for the time of a `with`.

    Args:
        settings: where the daemon is.
        own: the endpoint.
        secret: the same for all connections of the endpoint.
        subscribe: to receive; else to send.

    Raises:
        BundleError: the daemon is another node.
        OSError, EOFError, AAP2Error, DecodeError: it cannot be reached, or refuses the endpoint.
    """
    client = _client(settings)
    try:
        async with asyncio.timeout(settings.answer_s):
            await _greet(client)
            if client.node_eid not in _spellings(node_of(own)):
                raise BundleError(f"the uD3TN daemon is {client.node_eid}, not {node_of(own)}")
            try:
                await client.configure(
                    _agent_id(own),
                    subscribe=subscribe,
                    secret=secret,
                    keepalive_seconds=settings.keepalive_s,
                )
            except AAP2OperationFailed as error:
                raise AAP2Error(f"{own} is refused, somebody else may have it: {error}") from error
        yield Connection(client, settings)
    finally:
        if (writer := getattr(client, "writer", None)) is not None:
            writer.transport.abort()  # closing would wait for a daemon that does not read
            with suppress(OSError):
                await writer.wait_closed()


def _client(settings: Aap2Settings) -> AAP2AsyncClient:
    if settings.tcp is not None:
        return AAP2AsyncTCPClient((settings.tcp.host, settings.tcp.port))
    return AAP2AsyncUnixClient(settings.socket)


def _spellings(node: Eid) -> tuple[str, ...]:
    """Return how a node may call itself; `ipn:1.0` is `ipn:0.1.0` where all three are said."""
    if isinstance(node, Ipn) and not node.allocator:
        return (str(node), f"ipn:0.{node.node}.0")
    return (str(node),)


async def _greet(client: AAP2AsyncClient) -> None:
    try:
        await client.connect()
    except TypeError as error:  # how it takes an empty message
        raise AAP2Error("no welcome") from error


def _agent_id(own: Eid) -> str:
    """Return what is registered: the part of an endpoint beyond its node."""
    if isinstance(own, Dtn):
        return own.name[len(str(node_of(own))) - len("dtn:") :]
    return str(own.service)


def _inbound(adu: BundleADU, payload: bytes) -> Inbound | None:
    try:
        source, destination = parse_eid(adu.src_eid), parse_eid(adu.dst_eid)
    except ValueError:
        return None
    creation = Creation(adu.creation_timestamp_ms, adu.sequence_number)
    return Inbound(source, destination, creation, payload)
