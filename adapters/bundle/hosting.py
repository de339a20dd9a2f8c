"""What a process needs that deploys an agent: its contact plan, and why it cannot listen."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from adapters.bundle.contact_plan import ContactPlan, read_plan
from adapters.bundle.eid import Ipn
from adapters.bundle.errors import BundleError
from adapters.bundle.links import Listen
from adapters.bundle.settings import NodeSettings

_FIRST_START: Final = ".begun"
_LOG: Final = logging.getLogger(__name__)


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
    settings_file: Path,
    name: str | None,
    data: Path,
    node: NodeSettings,
    utc_s: Callable[[], float] = time.time,
) -> ContactPlan | None:
    """Return the contact plan that a settings file names; warn of ways that it never opens.

    What is relative in it counts from the first start with this plan, until the plan changes.

    Args:
        settings_file: the plan is beside it.
        name: of the plan; None for none.
        data: the folder where that first start is kept, under the name of the settings.
        node: the agent that is to follow it.
        utc_s: the time in seconds since 1970.

    Raises:
        adapters.bundle.contact_plan.PlanError: it cannot be read.
        BundleError: the start cannot be kept.
    """
    if name is None:
        return None
    path, now_s = settings_file.parent / name, utc_s()
    read_plan(path, now_s)
    kept = data / f"{settings_file.stem}{_FIRST_START}"
    plan = read_plan(path, _first_start_utc_s(path.read_bytes(), kept, now_s))
    for sender, receiver in _never_open(plan, node, now_s):
        _LOG.warning(
            "contact plan %s: from node %d to node %d no contact is planned from now on;"
            " `a contact BEGIN END %d %d RATE` plans one",
            *(path, sender, receiver, sender, receiver),
        )
    return plan


def _never_open(plan: ContactPlan, node: NodeSettings, now_s: float) -> Iterator[tuple[int, int]]:
    """Yield the ways to neighbours and from them that are closed for ever: from node, to node."""
    for neighbour in node.neighbours:
        if isinstance(node.node, Ipn) and isinstance(neighbour.node, Ipn):
            own, other = node.node.node, neighbour.node.node
            ways = ((own, other), (other, own))
            yield from (way for way in ways if not plan.planned(*way, now_s))


def _first_start_utc_s(plan: bytes, kept: Path, now_s: float) -> float:
    """Return when a plan was first started with; a file keeps the time, and the plan after it."""
    if kept.is_file():
        first, _, known = kept.read_bytes().partition(b"\n")
        with suppress(ValueError):
            if known == plan:
                return datetime.fromisoformat(first.decode()).timestamp()
    first = datetime.fromtimestamp(now_s, UTC).isoformat().encode()
    fresh = kept.with_name(f"{kept.name}.new")
    try:
        fresh.write_bytes(first + b"\n" + plan)
        fresh.replace(kept)
    except OSError as error:
        raise BundleError(
            f"{kept.parent} cannot be written: {error.strerror}; make room there, or name another"
            " folder with --data"
        ) from error
    return now_s
