"""What a process needs that deploys an agent: its folder to itself, and its contact plan."""

import fcntl
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from adapters.bundle.contact_plan import ContactPlan, read_plan
from adapters.bundle.errors import StoreError
from adapters.bundle.links import Listen

_FIRST_START: Final = "contact_plan.begun"


@contextmanager
def exclusive(folder: Path, lock: str) -> Iterator[None]:
    """Make a folder and hold it; the kernel lets go of it however this process ends.

    Args:
        folder: where the store lies.
        lock: name of the file that is held.

    Raises:
        StoreError: it cannot be made, or another process holds it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = (folder / lock).open("a")
    except OSError as error:
        why = f"{folder} cannot be used: {error.strerror}"
        raise StoreError(f"{why}; --data names another folder") from error
    with held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise StoreError(
                f"another process works in {folder}: stop it, or give this one a folder of its own"
                " with --data"
            ) from error
        yield


def in_the_way(error: OSError, listen: Listen, settings_file: Path) -> str:
    """Return why an agent cannot listen, and what to do."""
    addresses = (listen.ltp, listen.tcpcl, listen.udp)
    where = ", ".join(f"{each.host}:{each.port}" for each in addresses if each is not None)
    why = os.strerror(error.errno) if error.errno and error.errno > 0 else error.strerror
    return (
        f"cannot listen for bundles at {where}: {why}; choose another address in section listen of"
        f" {settings_file}, and tell it to the other end"
    )


def plan_beside(
    settings_file: Path, name: str | None, data: Path, utc_s: Callable[[], float] = time.time
) -> ContactPlan | None:
    """Return the contact plan that a settings file names.

    What is relative in it counts from the first start with this plan, until the plan changes.

    Args:
        settings_file: the plan is beside it.
        name: of the plan; None for none.
        data: the folder where that first start is kept.
        utc_s: the time in seconds since 1970.

    Raises:
        adapters.bundle.contact_plan.PlanError: it cannot be read.
        OSError: the start cannot be kept.
    """
    if name is None:
        return None
    path, now_s = settings_file.parent / name, utc_s()
    read_plan(path, now_s)
    return read_plan(path, _first_start_utc_s(path.read_bytes(), data / _FIRST_START, now_s))


def _first_start_utc_s(plan: bytes, kept: Path, now_s: float) -> float:
    """Return when a plan was first started with; a file keeps the time, and the plan after it."""
    if kept.is_file():
        first, _, known = kept.read_bytes().partition(b"\n")
        with suppress(ValueError):
            if known == plan:
                return datetime.fromisoformat(first.decode()).timestamp()
    first = datetime.fromtimestamp(now_s, UTC).isoformat().encode()
    fresh = kept.with_suffix(".new")
    fresh.write_bytes(first + b"\n" + plan)
    fresh.replace(kept)
    return now_s
