"""Commands that an earlier process sent, and was killed before it wrote them down."""

import logging
from collections.abc import Iterable
from contextlib import suppress
from itertools import takewhile
from typing import Final

from adapters.bundle import Queued
from adapters.mops.dictionary import Dictionary
from adapters.mops.message import MopsError, decode
from adapters.mops.reports import LINK
from adapters.orbiter.record import Record
from executive.commands import Command, Identity
from executive.ledger import LedgerError

_LOG: Final = logging.getLogger(__name__)


def write_down(
    queued: Iterable[Queued], record: Record, dictionary: Dictionary, utc_s: float
) -> None:
    """Write down which commands are in the outbox, so that a repeat does not go up as well.

    Before what was written down there is none that was not. None has left the outbox meanwhile: a
    command is written down before the next octet comes in.

    Args:
        queued: what is in the outbox to a rover, the newest first.
        record: of that rover.
        dictionary: spells commands.
        utc_s: the time in seconds since 1970.

    Raises:
        LedgerError: the record cannot be read.
    """
    for each in takewhile(lambda each: not record.asked.knows(each.identity), queued):
        try:
            message = decode(each.payload)
            request = dictionary.request(message)
        except MopsError:
            continue
        if message.moe_inputs_id is None:
            continue
        identity = Identity(message.source, message.moe_inputs_id)
        if record.ledger.digest_of(identity) is None:
            command = Command(identity, request, LINK, counter=message.moe_inputs_counter)
            _LOG.info("%s went up before it was written down", identity)
            with suppress(LedgerError):  # it stays gathered, and is written with what comes next
                record.asked.sent(command, each.payload, each.identity, utc_s, each.expires_utc_s)
