"""The Plan service but for its commands: how far plans have come.

Submitting, activating and the rest are commands with a life: `requests` maps them.
"""

import asyncio
from collections.abc import Sequence
from typing import Final

from adapters.mal import Call
from adapters.mrs import spec as wire
from adapters.mrs.aboard.gateway import Gateway
from adapters.mrs.aboard.served_operations import ServedOperations
from adapters.mrs.spec import AreaError, require_few, wire_update, with_text
from executive.reports import PlanUpdate
from executive.runner import Executive
from executive.settings import Settings

SERVICE: Final = "Plan"


class PlanService:
    """Serves getPlanStatus and monitorPlanExecution; `publish` is called on the provider's loop."""

    def __init__(self, offer: ServedOperations, core: Gateway, settings: Settings) -> None:
        """Put the operations up."""
        self._core = core
        self._settings = settings
        self._publisher = offer.publisher(SERVICE, "monitorPlanExecution")
        offer.serve(SERVICE, "getPlanStatus", self._get)

    def publish(self, update: PlanUpdate) -> None:
        """Broadcast how far a plan has come."""
        self._publisher.publish(
            wire_update(update),
            keys=(self._settings.asset, update.plan_id, update.status.value),
            domain=self._settings.domain,
            source=self._settings.asset,
            droppable=False,
        )

    def _get(
        self, call: Call, plan_ids: tuple[str, ...]
    ) -> asyncio.Future[tuple[tuple[wire.PlanUpdate, ...]]]:
        require_few(plan_ids)
        return self._core.ask(lambda executive: (_updates(executive, plan_ids),))


def _updates(executive: Executive, wanted: Sequence[str]) -> tuple[wire.PlanUpdate, ...]:
    known = {update.plan_id: update for update in executive.plans()}
    for plan_id in wanted:
        if plan_id not in known:
            raise with_text(AreaError.NOT_FOUND, plan_id)
    return tuple(wire_update(known[plan_id]) for plan_id in wanted or known)
