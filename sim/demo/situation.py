"""What mission control sees of a rover by one link, and of the relay on the way to it."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, nan

from adapters.mrs.client import MrsClient
from adapters.mrs.stored import LAST_HEARD, NEXT_CONTACT
from adapters.mrs.types import AssetMode
from adapters.relay.orbiter import link_status
from executive.parameters import Parameter


@dataclass(frozen=True, slots=True)
class Sky:
    """How the relay is doing; infinity for what it does not know.

    Attributes:
        queued: how many bundles wait at the orbiter.
        oldest_s: how long the oldest command has waited there.
        next_contact_s: until contact begins, 0 during one.
        last_heard_s: since something was heard of the rover.
    """

    queued: float
    oldest_s: float
    next_contact_s: float
    last_heard_s: float

    @property
    def dark(self) -> bool:
        """Whether there is no contact."""
        return self.next_contact_s > 0


@dataclass(frozen=True, slots=True)
class Situation:
    """What the rover says of itself; NaN what it does not know.

    Attributes:
        sky: how the relay is doing; None by the direct link.
    """

    mode: AssetMode
    x_m: float
    y_m: float
    heading_rad: float
    travel_mps: float
    battery_v: float
    sky: Sky | None = None


async def look(client: MrsClient) -> Situation:
    """Ask the rover, or the relay in its place, how it is."""
    status = await client.get_status()
    figures = {
        value.name: float(value.value.value) for value in status.values if value.value is not None
    }
    relayed = any(value.name == link_status.QUEUED for value in status.values)
    return Situation(
        status.mode,
        figures.get(Parameter.POS_X.value, nan),
        figures.get(Parameter.POS_Y.value, nan),
        figures.get(Parameter.HEAD.value, nan),
        figures.get(Parameter.CURRENT_TRAVEL_SPEED.value, nan),
        figures.get(Parameter.BATERY_VOLTAGE.value, nan),
        _sky(figures) if relayed else None,
    )


def _sky(figures: Mapping[str, float]) -> Sky:
    return Sky(
        figures.get(link_status.QUEUED, inf),
        figures.get(link_status.OLDEST, inf),
        figures.get(NEXT_CONTACT, inf),
        figures.get(LAST_HEARD, inf),
    )
