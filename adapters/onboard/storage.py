"""Where one executive keeps its record and its files, which no other may touch meanwhile."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path


class StorageError(Exception):
    """The folder cannot be used; the text says why and what to do."""


@dataclass(frozen=True, slots=True)
class Storage:
    """The files of one asset."""

    ledger: Path
    files: Path


@contextmanager
def exclusive_storage(folder: Path) -> Iterator[Storage]:
    """Make the folder and hold it; the kernel lets go of it however this process ends.

    Raises:
        StorageError: another executive holds it, or it cannot be made.
    """
    lock = folder / "lock"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = lock.open("a+", encoding="utf-8")
    except OSError as error:
        raise StorageError(f"{folder} cannot be used: {error.strerror}") from error
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            held.seek(0)
            raise StorageError(
                f"another executive (process {held.read().strip() or 'unknown'}) works on the"
                f" ledger in {folder}: stop it, or give this one a folder of its own with --data"
            ) from error
        held.truncate(0)
        held.write(f"{os.getpid()}\n")
        held.flush()
        yield Storage(folder / "ledger.sqlite", folder / "files")
