"""Every operation that carries a command: Motion Control, Camera, and Status's interval.

This is the stop path. Between the octets and the core's inbox lie the decoding of the message, the
making of one command and one future, and nothing else.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any

from adapters.mal.provider import Call
from adapters.mrs.core import Core
from adapters.mrs.headers import command_of
from adapters.mrs.offer import Offer
from adapters.mrs.requests import REQUESTS
from adapters.mrs.types import CommandHeader
from executive.commands import Request


def serve_commands(offer: Offer, core: Core) -> None:
    """Put up all operations of `REQUESTS`; each is acknowledged when the core has admitted it."""
    for (service, operation), make in REQUESTS.items():
        offer.serve(service, operation, partial(_submit, core, make))


def _submit(
    core: Core, make: Callable[..., Request], call: Call, header: CommandHeader, *parts: Any
) -> asyncio.Future[None]:
    return core.submit(command_of(header, call.supplements, make(*parts)))
