"""Exclusive folder of a process."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from adapters.process.command import StartError


def default_folder(name: str) -> Path:
    """Return the default folder of a process's files."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "rover" / name


@contextmanager
def exclusive(folder: Path, lock: str) -> Iterator[None]:
    """Create a folder and lock it; the kernel releases the lock however this process ends.

    The file `lock` in it has this process's id while it runs, and is empty after it (unless
    killed).

    Raises:
        StartError: another process holds the lock, or the folder cannot be created.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = (folder / lock).open("a+", encoding="utf-8")
    except OSError as error:
        why = f"{folder} cannot be used: {error.strerror}"
        raise StartError(f"{why}; --data names another folder") from error
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            held.seek(0)
            raise StartError(
                f"another process ({held.read().strip() or 'unknown'}) uses {folder}: stop it,"
                " or give this one a folder of its own with --data"
            ) from error
        try:
            os.ftruncate(held.fileno(), 0)
            os.write(held.fileno(), f"{os.getpid()}\n".encode())
        except OSError as error:
            raise StartError(
                f"{folder} cannot be written: {error.strerror}; free some space, or name another"
                " folder with --data"
            ) from error
        try:
            yield
        finally:
            with suppress(OSError):
                os.ftruncate(held.fileno(), 0)
