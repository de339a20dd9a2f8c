"""The operations that read the rover's state, and which text commands it has."""

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from adapters.mal import Call
from adapters.mrs import values
from adapters.mrs.core import Core
from adapters.mrs.offer import Offer
from executive.runner import Executive

READS: Final[tuple[tuple[str, str, Callable[[Executive], Any]], ...]] = (
    ("Action", "listActions", values.actions),
    ("MotionControl", "getPose", values.pose),
    ("MotionControl", "getSpeeds", values.speeds),
    ("Camera", "getState", values.camera_state),
    ("Status", "getStatusInterval", lambda executive: executive.telemetry.interval_s),
    ("Status", "getStatus", values.asset_status),
)


def serve_state(offer: Offer, core: Core) -> None:
    """Put up all operations of `READS`."""
    for service, operation, read in READS:
        offer.serve(service, operation, partial(_read, core, read))


def _read(core: Core, read: Callable[[Executive], Any], _: Call) -> asyncio.Future[tuple[Any, ...]]:
    return core.ask(lambda executive: (read(executive),))
