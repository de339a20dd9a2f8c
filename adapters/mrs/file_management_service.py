"""The File Management service but for its commands: what files are like, and what happens to them.

`delete` and `move` are commands with a life: `requests` maps them.
"""

import asyncio
from typing import Final

from adapters.mal import Call, MalError
from adapters.mrs.errors import AreaError, invalid
from adapters.mrs.file_infos import file_info, meta_data, mime_type
from adapters.mrs.file_reading import Checksums, not_found
from adapters.mrs.file_watch import FileWatch, MetaData
from adapters.mrs.offer import Offer
from adapters.mrs.types import FileEventType, FileInfo
from executive.settings import Settings
from executive.state import FileEventKind, FileFolder, FileStamp

SERVICE: Final = "FileManagement"


class FileManagementService:
    """Serves fileStored, monitorFiles and getAttributes.

    Attributes:
        watch: is told what happens to files, and has it published.
    """

    def __init__(
        self, offer: Offer, folder: FileFolder, checksums: Checksums, settings: Settings
    ) -> None:
        """Put the operations up, and watch the folder from now on."""
        self._folder = folder
        self._checksums = checksums
        self._settings = settings
        self._publisher = offer.publisher(SERVICE, "monitorFiles")
        self.watch = FileWatch(folder, self._publish)
        offer.serve(SERVICE, "fileStored", self._stored)
        offer.serve(SERVICE, "getAttributes", self._attributes)

    def look(self, path: str) -> tuple[FileStamp | None, MetaData]:
        """Return what a file is like, None if there is none; may be called from any thread."""
        return self._folder.stamp(path), meta_data(self._folder, path)

    def _publish(
        self, kind: FileEventKind, path: str, stamp: FileStamp, about: MetaData = None
    ) -> None:
        file = file_info(path, stamp, self._checksums.known(stamp), about)
        self._publisher.publish(
            FileEventType(kind.value),
            file,
            keys=(self._settings.asset, kind.value, mime_type(path)),
            domain=self._settings.domain,
            source=self._settings.asset,
            droppable=False,
        )

    async def _stored(self, call: Call, file: FileInfo) -> None:
        """Publish that a file was stored, if it is there as said: path, size, checksum if given."""
        stamp, about = await asyncio.to_thread(self.look, file.path)
        if stamp is None or stamp.size_octets != file.size:
            raise invalid(0)
        if file.checksum is not None:
            try:
                fits = await self._checksums.of(file.path, stamp) == file.checksum
            except MalError:
                fits = False
            if not fits:
                raise invalid(0)
        self.watch.hear(FileEventKind.STORED, file.path, stamp, about)

    async def _attributes(self, call: Call, path: str) -> tuple[FileInfo]:
        stamp, about = await asyncio.to_thread(self.look, path)
        if stamp is None:
            raise not_found(path)
        checksum: int | None = None
        try:
            checksum = await self._checksums.of(path, stamp)
        except MalError as error:
            if error.number == AreaError.NOT_FOUND.value:
                raise
        return (file_info(path, stamp, checksum, about),)
