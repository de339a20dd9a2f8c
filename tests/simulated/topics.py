"""Topics of ROS 2 between simulated processes: discovery takes time, samples get lost."""

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from tests.simulated.loop import SimLoop
    from tests.simulated.process import Incarnation, Process
    from tests.simulated.world import World

_DISCOVERY_S: Final = (1.0, 2.0)
_DELIVERY_S: Final = 0.001


class Subscription:
    """A callback of a process for one topic."""

    def __init__(
        self,
        incarnation: "Incarnation",
        loop: "SimLoop",
        name: str,
        callback: Callable[[Any], object],
    ) -> None:
        self.incarnation, self.loop, self.name, self.callback = incarnation, loop, name, callback


class Publisher:
    """Publishes on one topic to those subscribers that it has discovered.

    Args:
        topics: of the world.
        incarnation: of the process that publishes.
        name: of the topic.
    """

    def __init__(self, topics: "Topics", incarnation: "Incarnation", name: str) -> None:
        self._topics, self._incarnation, self.name = topics, incarnation, name
        self._matched: dict[Subscription, float] = {}

    def publish(self, sample: Any) -> None:
        """Publish; samples keep their order to each subscriber."""
        if not self._incarnation.alive:
            return
        topics, now_s = self._topics, self._topics.world.now_s
        for subscription, last_s in self._matched.items():
            if topics.loss and topics.chance.random() < topics.loss:
                continue
            arrival_s = max(last_s, now_s + _DELIVERY_S * topics.chance.random())
            self._matched[subscription] = arrival_s
            loop = subscription.loop
            handle = asyncio.Handle(subscription.callback, (sample,), loop)
            subscription.incarnation.push(arrival_s - now_s, loop, handle)

    @property
    def subscriber_count(self) -> int:
        """How many subscribers it has discovered and not lost."""
        return len(self._matched)

    @property
    def subscribers(self) -> frozenset[object]:
        """Those that it has discovered and not lost."""
        return frozenset(self._matched)

    def discover(self, subscription: Subscription) -> None:
        """Know a subscriber from now on."""
        if self._incarnation.alive and subscription.incarnation.alive:
            self._matched[subscription] = 0.0

    def forget(self, subscription: Subscription) -> None:
        """Know that a subscriber is gone."""
        self._matched.pop(subscription, None)

    def drop(self, *, silent: bool) -> None:
        """Publish no more."""
        self._topics.publishers.remove(self)
        self._matched.clear()


class _Subscribed:
    """What a process loses of a subscription when it ends."""

    def __init__(self, topics: "Topics", subscription: Subscription) -> None:
        self._topics, self._subscription = topics, subscription

    def drop(self, *, silent: bool) -> None:
        """Have publishers lose it: at once, or as late as discovery is where nobody is told."""
        topics, closed = self._topics, self._subscription
        topics.subscriptions.remove(closed)
        for publisher in topics.publishers:
            delay_s = topics.chance.uniform(*topics.discovery_s) if silent else 0.0
            topics.world.after(delay_s, publisher.forget, closed)


class Topics:
    """All topics of a world.

    Attributes:
        loss: the part of samples that is lost.
        discovery_s: within which times publishers discover subscribers.
        publishers, subscriptions: of processes that are alive.
    """

    def __init__(self, world: "World") -> None:
        self.world = world
        self.chance = world.random("topics")
        self.loss = 0.0
        self.discovery_s = _DISCOVERY_S
        self.publishers: list[Publisher] = []
        self.subscriptions: list[Subscription] = []

    def publisher(self, process: "Process", name: str) -> Publisher:
        """Return a publisher of a process, which discovers subscribers from now on."""
        incarnation = process.present
        incarnation.require()
        publisher = Publisher(self, incarnation, name)
        self.publishers.append(publisher)
        incarnation.resources.append(publisher)
        for subscription in self.subscriptions:
            self._match(publisher, subscription)
        return publisher

    def subscribe(
        self,
        process: "Process",
        name: str,
        callback: Callable[[Any], object],
        loop: "SimLoop | None" = None,
    ) -> None:
        """Have samples handed to a callback of a process, on a loop of it: its main if None."""
        incarnation = process.present
        incarnation.require()
        subscription = Subscription(incarnation, loop or process.loop, name, callback)
        self.subscriptions.append(subscription)
        incarnation.resources.append(_Subscribed(self, subscription))
        for publisher in self.publishers:
            self._match(publisher, subscription)

    def _match(self, publisher: Publisher, subscription: Subscription) -> None:
        if publisher.name == subscription.name:
            delay_s = self.chance.uniform(*self.discovery_s)
            self.world.after(delay_s, publisher.discover, subscription)
