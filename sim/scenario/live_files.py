"""The files of a live run: fetched over the socket, and compared with what lies aboard."""

import tempfile
from pathlib import Path

from adapters.mal.errors import MalError
from adapters.mrs.client import MrsClient
from adapters.mrs.errors import in_words
from adapters.mrs.retrieval import TransferError
from adapters.mrs.types import FileEventType, FileInfo
from executive.files import FileEvent, FileEventKind
from sim.scenario.record import Fetched, NotFetched


async def fetched(client: MrsClient, path: str, aboard: Path) -> Fetched | NotFetched:
    """Fetch a file.

    Args:
        client: connected with the rover.
        path: of the file, in the folder aboard.
        aboard: that folder, which only a simulated rover lets us look into.

    Raises:
        ConnectionError: the rover could not be reached any more.
    """
    with tempfile.TemporaryDirectory(prefix="rover-fetched-") as folder:
        here = Path(folder) / "fetched"
        try:
            file = await client.retrieve_file(path, here)
        except MalError as error:
            return NotFetched(path, in_words(error))
        except TransferError as error:
            return NotFetched(path, str(error))
        assert file.checksum is not None
        return Fetched(path, here.read_bytes(), (aboard / path).read_bytes(), file.checksum)


def event(kind: FileEventType, file: FileInfo) -> FileEvent:
    """Return what a notice of monitorFiles says."""
    return FileEvent(FileEventKind(kind.value), file.path)
