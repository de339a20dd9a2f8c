"""What the ground does with the files of a rover but change them: list, describe, fetch, watch."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from adapters.mal import MalError, Subscription, UpdateHeader
from adapters.mrs.feed import SUBSCRIPTION
from adapters.mrs.questions import LOST, Questions
from adapters.mrs.retrieval import Retrieval
from adapters.mrs.rover_consumer import RoverConsumer
from adapters.mrs.session import Session
from adapters.mrs.stream import Stream
from adapters.mrs.types import FileEventType, FileInfo


@dataclass(frozen=True, slots=True)
class FileNews:
    """Something that happened to a file aboard.

    Attributes:
        file: as it is now, or as it was last if it is gone.
    """

    event: FileEventType
    file: FileInfo


class FilesClient(Questions):
    """The part of `MrsClient` that is about files. To move or delete them takes commands."""

    def __init__(self, session: Session) -> None:
        """Speak over this session."""
        super().__init__(session)
        self._file_news: list[Stream[FileNews]] = []

    async def list_files(self, folder: str | None = None) -> tuple[FileInfo, ...]:
        """Return the files of a folder and of the folders in it, None for all.

        A rover names at most a thousand, those that were changed last.
        """
        files: tuple[FileInfo, ...] = await self._one("FileTransfer", "listFiles", folder)
        return files

    async def get_attributes(self, path: str) -> FileInfo:
        """Return what a file is like, its checksum and what is known of it included."""
        file: FileInfo = await self._one("FileManagement", "getAttributes", path)
        return file

    async def cancel_transfer(self, path: str) -> None:
        """End every transfer of a file, to whomever."""
        await self._tell("FileTransfer", "cancelTransfer", path)

    async def file_stored(self, file: FileInfo) -> None:
        """Have a file announced that was put into the folder aboard."""
        await self._tell("FileManagement", "fileStored", file)

    async def file_events(self) -> Stream[FileNews]:
        """Return what happens to files from now on; not what happens while the link is lost."""
        stream: Stream[FileNews] = Stream()
        self._file_news.append(stream)
        await self._subscribe_files(await self._session.consumer())
        return stream

    async def retrieve_file(
        self,
        path: str,
        to: Path,
        on_progress: Callable[[int, int], None] = lambda _done, _size: None,
        chunk_octets: int | None = None,
    ) -> FileInfo:
        """Fetch a file over a connection of its own, from where a former attempt ended.

        After a loss of the link it goes on with the rest. What came so far lies beside `to`, in
        `NAME.CHECKSUM.part`, also when this is interrupted; `to` is there when all has come and
        its checksum is right.

        Args:
            path: the file aboard.
            to: what it is to be here; a file of that name is replaced.
            on_progress: called with the octets that are here, and those of the whole.
            chunk_octets: of one message, None for the rover's choice. Less for a slow link: each
                chunk has to come within the session's `timeout_s`.

        Returns:
            What the rover says of the file.

        Raises:
            TransferError: the file was changed aboard meanwhile, or what came is not what is there.
            OSError: it cannot be written here.
        """
        file = await self.get_attributes(path)
        session = self._session.twin()
        await session.open(patiently=True)
        try:
            await Retrieval(session, file, to, on_progress, chunk_octets).run()
        finally:
            await session.close()
        return file

    async def _tell(self, service: str, operation: str, *parts: object) -> None:
        consumer = await self._session.consumer()
        try:
            await consumer.submit(service, operation, *parts)
        except MalError as error:
            if error.number not in LOST:
                raise
            await self._session.drop(consumer)
            raise ConnectionError("the link was lost before the rover answered") from error

    async def _restore_files(self, consumer: RoverConsumer) -> None:
        if any(not stream.closed for stream in self._file_news):
            await self._subscribe_files(consumer)

    async def _subscribe_files(self, consumer: RoverConsumer) -> None:
        await consumer.subscribe(
            "FileManagement",
            "monitorFiles",
            Subscription(subscriptionId=SUBSCRIPTION),
            self._on_file,
        )

    def _on_file(self, _: UpdateHeader, event: FileEventType, file: FileInfo) -> None:
        for stream in self._file_news:
            stream.put(FileNews(event, file))

    def _end_file_streams(self, fault: Exception | None) -> None:
        for stream in self._file_news:
            stream.close(fault)
