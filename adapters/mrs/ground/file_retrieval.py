"""`FileRetrieval` fetches a file from a rover across losses of the link; verifies its checksum."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final
from zlib import crc32

from adapters.mal import MalError, StandardError
from adapters.mrs.ground.queries import LINK_LOST_ERRORS
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.ground.session import RoverSession
from adapters.mrs.spec import FileEventType, FileInfo

READ_OCTETS: Final = 1 << 20
MAX_ATTEMPTS: Final = 5
"""Maximum successive attempts without a received octet; chosen, not measured."""
RETRYABLE_ERRORS: Final = {
    StandardError.DELIVERY_TIMEDOUT.value,
    StandardError.TRANSACTION_TIMEOUT.value,
    *LINK_LOST_ERRORS,
}
"""Errors of a lost or stalled transfer, after which it is retried."""


def checksum_of(path: Path) -> int:
    """Return the CRC-32 of a local file."""
    value = 0
    with path.open("rb") as file:
        while octets := file.read(READ_OCTETS):
            value = crc32(octets, value)
    return value


@dataclass(frozen=True, slots=True)
class FileNotification:
    """A change of an onboard file.

    Attributes:
        file: its attributes after the change; the last ones if it was deleted.
    """

    event: FileEventType
    file: FileInfo


class TransferError(Exception):
    """The received octets are not the onboard file; the text gives the reason."""


class FileRetrieval:
    """Transfer of one file from the rover.

    The received octets are stored in a file with the expected checksum in its name. A later attempt
    continues with them only if the content is still the same.

    Args:
        session: an open session for this transfer only: closing it ends the rover's transmission.
        to: the local file.
        on_progress: called with the received octets and the size.
        chunk_octets: octets of a chunk; None for the rover's default.
    """

    def __init__(
        self,
        session: RoverSession,
        file: FileInfo,
        to: Path,
        on_progress: Callable[[int, int], None],
        chunk_octets: int | None,
    ) -> None:
        """Prepare the transfer.

        Raises:
            TransferError: the rover has no checksum of the file.
        """
        if file.checksum is None:
            raise TransferError(f"{file.path} has no checksum: unreadable aboard or being written")
        self._session = session
        self._file = file
        self._to = to
        self._part = to.with_name(f"{to.name}.{file.checksum:08x}.part")
        self._on_progress = on_progress
        self._chunk_octets = chunk_octets

    async def run(self) -> None:
        """Fetch it; raises as `MrsClient.retrieve_file` does."""
        self._part.parent.mkdir(parents=True, exist_ok=True)
        if self._part.exists() and self._part.stat().st_size > self._file.size:
            self._part.unlink()
        idle = 0
        with self._part.open("ab") as part:
            while True:
                before = part.tell()
                consumer = await self._session.consumer()
                try:
                    await self._receive(consumer, part)
                    break
                except MalError as error:
                    idle = 0 if part.tell() > before else idle + 1
                    if error.number not in RETRYABLE_ERRORS or idle > MAX_ATTEMPTS:
                        raise
                    await self._session.drop(consumer)
        await asyncio.to_thread(self._check)
        self._part.replace(self._to)

    async def _receive(self, consumer: RoverConsumer, part: BinaryIO) -> None:
        path, size = self._file.path, self._file.size
        request = (path, part.tell(), self._chunk_octets)
        async with consumer.progress("FileTransfer", "retrieveFile", *request) as progress:
            (now,) = progress.acknowledgement
            if (now.size, now.checksum) != (size, self._file.checksum):
                self._part.unlink()
                raise TransferError(f"{path} was changed aboard: fetch it again")
            self._on_progress(part.tell(), size)
            async for (chunk,) in progress:
                if chunk.offset != part.tell() or chunk.offset + len(chunk.data) > size:
                    raise TransferError(f"{path}: a chunk does not fit the octets before it")
                part.write(chunk.data)
                self._on_progress(part.tell(), size)

    def _check(self) -> None:
        value = checksum_of(self._part)
        if value != self._file.checksum:
            self._part.unlink()
            text = f"{self._file.path}: CRC-32 of the received file is {value:08x}, aboard it is "
            raise TransferError(f"{text}{self._file.checksum:08x}: fetch it again")
