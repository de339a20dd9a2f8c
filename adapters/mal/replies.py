"""The way back: replies and errors, on the connection that the message came on."""

import logging
import time
from typing import Any, Final

from adapters.mal.codec import Codec
from adapters.mal.connection import Connection
from adapters.mal.errors import EncodeError, MalError, StandardError
from adapters.mal.header import Header, encode_message
from adapters.mal.specification import Operation, Stage
from adapters.mal.stages import REPLY

_LOG: Final = logging.getLogger(__name__)


class Replies:
    """Encodes and sends what answers a message, in any of the stages that follow it."""

    def __init__(self, codec: Codec) -> None:
        """Write bodies with a codec."""
        self._codec = codec

    def send(
        self,
        connection: Connection,
        header: Header,
        operation: Operation,
        stage: Stage,
        parts: tuple[Any, ...] | None,
    ) -> None:
        """Send a reply.

        Raises:
            EncodeError: The parts are not those of the stage.
        """
        body = self._codec.encode(operation.parts[stage], parts or ())
        connection.send(encode_message(_turned(header, stage, is_error=False), body))

    def refuse(
        self, connection: Connection, header: Header, error: MalError, stage: Stage | None = None
    ) -> None:
        """Send an error in place of the reply of a stage, the first if none is given."""
        if header.stage is Stage.SEND:
            _LOG.info("SEND from %s dropped: %s", header.from_uri, error)
            return
        try:
            body = self._codec.encode_error(error)
        except EncodeError:
            _LOG.exception("error %d with extra information that does not fit", error.number)
            body = self._codec.encode_error(MalError(error.number))
        turned = _turned(header, stage or REPLY[header.stage], is_error=True)
        connection.send(encode_message(turned, body))

    def fault(self, connection: Connection, header: Header, stage: Stage | None = None) -> None:
        """Log the exception being handled, and answer INTERNAL."""
        _LOG.exception("no answer to operation %d of service %d", header.operation, header.service)
        self.refuse(connection, header, MalError(StandardError.INTERNAL), stage)


def _turned(header: Header, stage: Stage, is_error: bool) -> Header:
    """The header of a reply to a message."""
    return Header(
        stage,
        header.area,
        header.service,
        header.operation,
        header.area_version,
        header.transaction_id,
        is_error,
        from_uri=header.to_uri,
        to_uri=header.from_uri,
        timestamp_ns=time.time_ns(),
    )
