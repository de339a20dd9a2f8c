"""What the ground hears of the plans of a rover. To send and steer them takes commands."""

from adapters.mal import Subscription, UpdateHeader
from adapters.mrs.feed import SUBSCRIPTION
from adapters.mrs.files_client import FilesClient
from adapters.mrs.rover_consumer import RoverConsumer
from adapters.mrs.session import Session
from adapters.mrs.stream import Stream
from adapters.mrs.types import PlanUpdate

SERVICE = "Plan"


class PlansClient(FilesClient):
    """The part of `MrsClient` that is about plans."""

    def __init__(self, session: Session) -> None:
        """Speak over this session."""
        super().__init__(session)
        self._plan_updates: list[Stream[PlanUpdate]] = []
        self._last_updates: dict[str, PlanUpdate] = {}

    async def get_plan_status(self, *plan_ids: str) -> tuple[PlanUpdate, ...]:
        """Return how far plans have come, all of them if none is named."""
        plans: tuple[PlanUpdate, ...] = await self._one(SERVICE, "getPlanStatus", plan_ids)
        return plans

    async def plan_updates(self) -> Stream[PlanUpdate]:
        """Return how far plans come from now on; after a loss of the link, first where they are."""
        stream: Stream[PlanUpdate] = Stream()
        self._plan_updates.append(stream)
        await self._subscribe_plans(await self._session.consumer())
        return stream

    async def _restore_plans(self, consumer: RoverConsumer) -> None:
        if all(stream.closed for stream in self._plan_updates):
            return
        await self._subscribe_plans(consumer)
        (plans,) = await consumer.request(SERVICE, "getPlanStatus", ())
        for update in plans:
            if self._last_updates.get(update.planId) != update:
                self._put_update(update)

    async def _subscribe_plans(self, consumer: RoverConsumer) -> None:
        await consumer.subscribe(
            SERVICE,
            "monitorPlanExecution",
            Subscription(subscriptionId=SUBSCRIPTION),
            self._on_update,
        )

    def _on_update(self, _: UpdateHeader, update: PlanUpdate) -> None:
        self._put_update(update)

    def _put_update(self, update: PlanUpdate) -> None:
        self._last_updates[update.planId] = update
        for stream in self._plan_updates:
            stream.put(update)

    def _end_plan_streams(self, fault: Exception | None) -> None:
        for stream in self._plan_updates:
            stream.close(fault)
