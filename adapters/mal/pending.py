"""What a consumer waits for once it has sent a message."""

import asyncio
from dataclasses import dataclass
from typing import Any, Protocol

from adapters.mal.errors import MalError
from adapters.mal.specification import Operation, Stage

Parts = tuple[Any, ...]


class Pending(Protocol):
    """What is told of the messages of a transaction."""

    @property
    def operation(self) -> Operation:
        """The operation of the transaction."""

    def expects(self, stage: Stage) -> bool:
        """Whether this message, or an error in its place, may come now."""

    def take(self, stage: Stage, parts: Parts, octets: int) -> None:
        """A message came, with a body of so many octets."""

    def fail(self, error: MalError) -> None:
        """An error came, or nothing will come any more."""


@dataclass(frozen=True, slots=True)
class SingleReply:
    """Waits for the one reply of a SUBMIT, a REQUEST, or a registration."""

    operation: Operation
    stage: Stage
    reply: asyncio.Future[Parts]

    def expects(self, stage: Stage) -> bool:
        """Whether it is the reply, and the first."""
        return stage is self.stage and not self.reply.done()

    def take(self, _stage: Stage, parts: Parts, _octets: int) -> None:
        """Complete the reply."""
        self.reply.set_result(parts)

    def fail(self, error: MalError) -> None:
        """Fail the reply."""
        if not self.reply.done():
            self.reply.set_exception(error)
