"""A process's folder, which it has to itself."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from adapters.process.command import StartError


def default_folder(name: str) -> Path:
    """Return where a process keeps its files unless told otherwise."""
    base = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(base) / "rover" / name


@contextmanager
def exclusive(folder: Path, lock: str) -> Iterator[None]:
    """Make a folder and lock it; the kernel releases the lock however this process ends.

    The file `lock` in it holds this process's id while it runs, and nothing afterwards (unless
    killed).

    Raises:
        StartError: another process holds it, or it cannot be made.
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
                f"another process ({held.read().strip() or 'unknown'}) works in {folder}: stop it,"
                " or give this one a folder of its own with --data"
            ) from error
        try:
            os.ftruncate(held.fileno(), 0)
            os.write(held.fileno(), f"{os.getpid()}\n".encode())
        except OSError as error:
            raise StartError(
                f"{folder} cannot be written: {error.strerror}; make room there, or name another"
                " folder with --data"
            ) from error
        try:
            yield
        finally:
            with suppress(OSError):
                os.ftruncate(held.fileno(), 0)
