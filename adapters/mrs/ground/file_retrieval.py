"""Fetches a file from a rover, over losses of the link, and makes sure that it is that file."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final
from zlib import crc32

from adapters.mal import MalError, StandardError
from adapters.mrs.ground.queries import LOST
from adapters.mrs.ground.rover_consumer import RoverConsumer
from adapters.mrs.ground.session import RoverSession
from adapters.mrs.spec import FileEventType, FileInfo

READ_OCTETS: Final = 1 << 20
TRIES: Final = 5
"""Attempts in a row that may bring nothing before the loss is somebody else's to mend."""
SILENT: Final = {
    StandardError.DELIVERY_TIMEDOUT.value,
    StandardError.TRANSACTION_TIMEOUT.value,
    *LOST,
}
"""What a transfer ends with when nothing comes any more: it is worth another try."""


@dataclass(frozen=True, slots=True)
class FileNotification:
    """Something that happened to a file aboard.

    Attributes:
        file: as it is now, or as it was last if it is gone.
    """

    event: FileEventType
    file: FileInfo


class TransferError(Exception):
    """What was received is not the file that is aboard; the text says why."""


class FileRetrieval:
    """One file on its way here.

    The octets that came lie in a file whose name tells the checksum of the whole, so that a later
    attempt goes on with them if, and only if, they are of the same content.

    Args:
        session: opened, and used for nothing else: closing it stops the rover from sending.
        file: as the rover describes it.
        to: where it is to be.
        on_progress: called with the octets that are here, and those of the whole.
        chunk_octets: of one message; None for the rover's choice.
    """

    def __init__(
        self,
        session: RoverSession,
        file: FileInfo,
        to: Path,
        on_progress: Callable[[int, int], None],
        chunk_octets: int | None,
    ) -> None:
        """Prepare.

        Raises:
            TransferError: the rover cannot tell the checksum.
        """
        if file.checksum is None:
            raise TransferError(f"{file.path} cannot be read aboard, or is being written just now")
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
                    if error.number not in SILENT or idle > TRIES:
                        raise
                    await self._session.drop(consumer)
        await asyncio.to_thread(self._check)
        self._part.replace(self._to)

    async def _receive(self, consumer: RoverConsumer, part: BinaryIO) -> None:
        path, size = self._file.path, self._file.size
        asked = (path, part.tell(), self._chunk_octets)
        async with consumer.progress("FileTransfer", "retrieveFile", *asked) as progress:
            (now,) = progress.acknowledgement
            if (now.size, now.checksum) != (size, self._file.checksum):
                self._part.unlink()
                raise TransferError(f"{path} was changed aboard meanwhile: fetch it again")
            self._on_progress(part.tell(), size)
            async for (chunk,) in progress:
                if chunk.offset != part.tell() or chunk.offset + len(chunk.data) > size:
                    raise TransferError(f"{path}: a chunk came that does not fit what came before")
                part.write(chunk.data)
                self._on_progress(part.tell(), size)

    def _check(self) -> None:
        value = 0
        with self._part.open("rb") as part:
            while data := part.read(READ_OCTETS):
                value = crc32(data, value)
        if value != self._file.checksum:
            self._part.unlink()
            text = f"{self._file.path}: the CRC-32 of what came is {value:08x}, aboard it is "
            raise TransferError(f"{text}{self._file.checksum:08x}: fetch it again")
