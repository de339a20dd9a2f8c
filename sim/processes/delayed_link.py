"""`rover link`: a TCP link with light time, lost messages and contact windows, before any rover.

Octets take half of the round trip in each direction, in order. TCP loses nothing, so that loss
drops whole MAL messages, as a full gateway does. Octets that are sent between two contacts wait for
the next one, as TCP transmits again until then: connections stay open, and nothing is answered.
"""

import asyncio
import logging
from collections import deque
from dataclasses import dataclass
from math import inf
from random import Random
from typing import Final, cast

import click

from adapters.mrs.cli import QuantityType, RoverTarget, to_option
from adapters.mrs.ground import parse_address
from adapters.process import PORT_NUMBER
from sim.processes.rover_address import HOST

_LOG: Final = logging.getLogger(__name__)
MAX_WAITING_OCTETS: Final = 16 << 20
"""Octets in transit to one end; with more, or if it does not read, the other end is not read."""
MAX_MESSAGE_OCTETS: Final = 64 << 20
"""Maximum octets of a MAL message; TLS and HTTP begin with octets that mean a larger length."""
LENGTH_OCTETS: Final = 4
"""Octets of the length at the start of a MAL message, CCSDS 521.0-B-3."""


@dataclass(frozen=True, slots=True)
class LinkConditions:
    """How a link transmits.

    Attributes:
        round_trip_s: twice the time from one end to the other, s.
        loss: share of the messages that are lost.
        contact_s: duration of each contact, s.
        period_s: time from the begin of a contact to that of the next one, s.
    """

    round_trip_s: float
    loss: float = 0.0
    contact_s: float = inf
    period_s: float = inf

    def arrival_s(self, sent_s: float) -> float:
        """Return when octets arrive that are sent at a time, both in s after the first contact."""
        into_s = sent_s % self.period_s
        wait_s = 0.0 if into_s < self.contact_s else self.period_s - into_s
        return sent_s + wait_s + self.round_trip_s / 2


class DelayedLink:
    """Relays connections to a rover; must be made while a loop runs, when the first contact begins.

    Args:
        host: host of the rover.
        port: its port.
        seed: seed of the losses.
    """

    def __init__(self, host: str, port: int, conditions: LinkConditions, seed: int = 0) -> None:
        self.address, self.conditions = (host, port), conditions
        self.chance = Random(seed)
        self._begin_s = asyncio.get_running_loop().time()

    async def serve(self, host: str, port: int) -> asyncio.Server:
        """Listen for clients; raises OSError."""
        loop = asyncio.get_running_loop()
        return await loop.create_server(lambda: _ClientEnd(self), host, port)

    def arrival_s(self) -> float:
        """Return the arrival time of octets that are sent now, by the clock of the loop."""
        now_s = asyncio.get_running_loop().time() - self._begin_s
        return self._begin_s + self.conditions.arrival_s(now_s)


class _End(asyncio.Protocol):
    """One end of a connection; it passes received octets to the other end."""

    def __init__(self, link: DelayedLink) -> None:
        self.link = link
        self.other: _End
        self.transport: asyncio.Transport | None = None
        self._in_transit, self._arrived = deque[bytes](), deque[bytes]()
        self._part, self._octets, self._blocked = b"", 0, False

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self.transport = cast(asyncio.Transport, transport)
        self._write_arrived()

    def data_received(self, data: bytes) -> None:
        """Called by asyncio."""
        if not self.link.conditions.loss:
            self.other.send(data)
            return
        self._part += data
        while len(self._part) >= LENGTH_OCTETS:
            length = int.from_bytes(self._part[:LENGTH_OCTETS], "big")
            if not LENGTH_OCTETS < length <= MAX_MESSAGE_OCTETS:
                _LOG.warning("no MAL messages in clear text, which losses need: disconnected")
                assert self.transport is not None, "it received octets"
                self.transport.abort()
                return
            if len(self._part) < length:
                return
            message, self._part = self._part[:length], self._part[length:]
            if self.link.chance.random() >= self.link.conditions.loss:
                self.other.send(message)

    def connection_lost(self, exc: Exception | None) -> None:
        """Called by asyncio."""
        self.other.send(b"")

    def pause_writing(self) -> None:
        """Called by asyncio."""
        self._blocked = True
        self._bound()

    def resume_writing(self) -> None:
        """Called by asyncio."""
        self._blocked = False
        self._bound()

    def send(self, octets: bytes) -> None:
        """Have octets arrive here; without any, the end of the connection."""
        self._in_transit.append(octets)
        self._octets += len(octets)
        asyncio.get_running_loop().call_at(self.link.arrival_s(), self._arrive)
        self._bound()

    def _arrive(self) -> None:
        self._arrived.append(self._in_transit.popleft())
        self._write_arrived()

    def _write_arrived(self) -> None:
        while self._arrived and self.transport is not None:
            octets = self._arrived.popleft()
            self._octets -= len(octets)
            if not octets:
                self.transport.close()
            elif not self.transport.is_closing():
                self.transport.write(octets)
        self._bound()

    def _bound(self) -> None:
        source = self.other.transport
        if source is not None and not source.is_closing():
            is_full = self._blocked or self._octets > MAX_WAITING_OCTETS
            source.pause_reading() if is_full else source.resume_reading()


class _ClientEnd(_End):
    """The end of a client; the connection to the rover is opened when its first octet could."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Called by asyncio."""
        self.other = _End(self.link)
        self.other.other = self
        loop = asyncio.get_running_loop()
        loop.call_at(self.link.arrival_s(), lambda: loop.create_task(self._connect()))
        super().connection_made(transport)

    async def _connect(self) -> None:
        try:
            loop = asyncio.get_running_loop()
            await loop.create_connection(lambda: self.other, *self.link.address)
        except OSError as error:
            _LOG.warning("%s:%d: %s", *self.link.address, error.strerror or error)
            self.send(b"")


@click.command()
@to_option
@click.option("--port", type=PORT_NUMBER, default=0, help="TCP port for clients.  [default: free]")
@click.option("--loss", type=click.FloatRange(0, 1), default=0.0, help="Share of lost messages.")
@click.option("--contact", type=QuantityType("s"), default=inf, help="Duration of a contact.")
@click.option("--every", type=QuantityType("s"), default=inf, help="Period of the contacts.")
@click.option("--seed", default=0, show_default=True, help="Seed of the losses.")
def link(to: RoverTarget, port: int, loss: float, contact: float, every: float, seed: int) -> None:
    """Simulate light time, losses and contacts of a direct link.

    It listens on this computer and relays to the rover at --to, until Ctrl-C. Each octet takes half
    of --delay. --loss drops whole MAL messages, in clear text only. With --contact and --every,
    octets that are sent outside of a contact wait for the next one; connections stay open. Clients
    need the same --delay.

    \b
    Examples:
      rover link --delay 10s --port 21500
      rover status --to 127.0.0.1:21500 --delay 10s
      rover link --delay 2.6s --loss 0.15 --contact 60s --every 300s
    """
    if (contact == inf) != (every == inf) or not 0.0 < contact <= every:
        raise click.UsageError("--contact and --every belong together: the contact is the shorter")
    conditions = LinkConditions(to.terms.round_trip_s, loss, contact, every)
    asyncio.run(_serve(to.uri, port, conditions, seed))


async def _serve(to: str, port: int, conditions: LinkConditions, seed: int) -> None:
    try:
        uri = parse_address(to)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--to") from error
    relay = DelayedLink(uri.host, uri.port, conditions, seed)
    try:
        server = await relay.serve(HOST, port)
    except OSError as error:
        raise click.ClickException(f"port {port} of {HOST}: {error.strerror}") from error
    bound = server.sockets[0].getsockname()[1]
    click.echo(f"link to {to} listens at maltcp://{HOST}:{bound}/MRS")
    await server.serve_forever()


if __name__ == "__main__":
    link()
