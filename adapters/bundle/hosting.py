"""What a process needs that deploys an agent: its folder to itself, and its contact plan."""

import fcntl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from adapters.bundle.contact_plan import ContactPlan, read_plan
from adapters.bundle.errors import StoreError


@contextmanager
def exclusive(folder: Path, lock: str) -> Iterator[None]:
    """Make a folder and hold it; the kernel lets go of it however this process ends.

    Args:
        folder: where the store lies.
        lock: name of the file that is held.

    Raises:
        OSError: it cannot be made.
        StoreError: another process holds it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / lock).open("a") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StoreError(
                f"another process works in {folder}: stop it, or give this one a folder of its own"
                " with --data"
            ) from error
        yield


def plan_beside(settings_file: Path, name: str | None) -> ContactPlan | None:
    """Return the contact plan that a settings file names; what is relative in it counts from now.

    Raises:
        adapters.bundle.contact_plan.PlanError: it cannot be read.
    """
    return None if name is None else read_plan(settings_file.parent / name, time.time())
