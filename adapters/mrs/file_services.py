"""Both services about files, put up together over what they share."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Final

from adapters.mrs.file_management_service import FileManagementService
from adapters.mrs.file_reading import Checksums
from adapters.mrs.file_transfer_service import FileTransferService
from adapters.mrs.offer import Offer
from executive.settings import Settings
from executive.state import FileFolder

READERS: Final = 2
"""Threads that read files: one may list a full folder while the other serves a transfer."""


def serve_files(offer: Offer, folder: FileFolder, settings: Settings) -> FileManagementService:
    """Put both services up, and return the one that hears of what happens to files.

    What blocks on the loop, in `asyncio.to_thread`, has `READERS` threads from now on.
    """
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(READERS, "files"))
    checksums = Checksums(folder)
    management = FileManagementService(offer, folder, checksums, settings)
    FileTransferService(offer, folder, checksums, management.watch)
    return management
