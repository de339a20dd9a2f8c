"""The bridge of `rover-relay` between bundles and MOPS strings, on a thread and loop of its own."""

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Final, Protocol

from adapters.bundle import ContactPlan, Delivery, Health, StoreError, make_agent
from adapters.mops import (
    UNNUMBERED,
    Dictionary,
    LinkHealth,
    Message,
    MopsError,
    health_message,
    messages_in,
    report_of,
)
from adapters.relay.rover.settings import RelaySettings

LOOK_S: Final = 1.0
PAUSE_S: Final = 0.2
AT_ONCE: Final = 100
LONGEST_PAYLOAD: Final = 65_536
MOST_QUEUED: Final = 10_000
"""Reports that wait for a store that is full; more are refused."""
NOBODY: Final = "nobody listens for them, neither rover-executive with --relay nor rover-nxt"
_LOG: Final = logging.getLogger(__name__)
_CommandKey = tuple[str, int | None, int | None]
"""Source, number and counter of a command, which its replies carry."""


class RoverTopics(Protocol):
    """The ROS topics, as the bridge uses them."""

    def publish(self, text: str, answered: Callable[[], bool]) -> bool:
        """Publish commands; return whether somebody has them. May block; on any thread.

        Args:
            text: whole messages.
            answered: whether something was said on each of them, so that somebody has them.
        """
        ...

    @property
    def has_listener(self) -> bool:
        """Whether somebody listens."""
        ...

    def confirm(self, sequence: int) -> None:
        """Say that a report is on the disk. On the loop's thread."""
        ...


class BundleBridge:
    """Sends each string as a bundle, and publishes what bundles hold, at least once.

    A bundle counts as delivered once somebody has its commands. After a kill in between it is
    published again: the rover's ledger, or the brick's record, knows a command by its source and
    number and executes it once.

    Args:
        settings: endpoints and links.
        path: the store of the bundles.
        plan: planned contacts; None for always.
        dictionary: how messages are spelled.
        topics: where strings leave.

    Attributes:
        health: how the link was doing at the last look, as the ground is told.
        agent_health: how the agent itself was.
        refused: messages and bundles that were not passed on.
    """

    def __init__(
        self,
        settings: RelaySettings,
        path: Path,
        plan: ContactPlan | None,
        dictionary: Dictionary,
        topics: RoverTopics,
    ) -> None:
        self._settings, self._topics = settings, topics
        self._entry = dictionary.spelling.link
        self._agent = make_agent(settings.node(), path, settings.daemon, settings.listen, plan)
        self._queue = SendQueue(dictionary, settings.telemetry_queue)
        self._filled = asyncio.Event()
        self._unanswered: frozenset[_CommandKey] = frozenset()
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._end: Callable[[], None] = lambda: None
        self.health: LinkHealth | None = None
        self.agent_health: Health | None = None
        self.refused = self._refused_before = 0

    @property
    def alive(self) -> bool:
        """Whether its thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self) -> None:
        """Open the agent on a thread of its own.

        Raises:
            BundleError: the store or the links cannot be used.
            OSError: an address cannot be had.
        """
        opened: Future[None] = Future()
        self._thread = threading.Thread(target=self._run, args=(opened,), name="bundles")
        self._thread.start()
        opened.result()

    def close(self) -> None:
        """Close the agent; what waits is kept."""
        if self._thread is not None:
            self._end()
            self._thread.join()

    def notify(self, text: str) -> None:
        """Take messages that are for the ground; from any thread."""
        self._post(self._on_notification, text)

    def set_plan(self, plan: ContactPlan | None) -> None:
        """Go by another contact plan; from any thread."""
        self._post(self._agent.set_plan, plan)

    def _refuse(self, line: str) -> None:
        """Count a message that is not passed on; log the first since the last look."""
        if self.refused == self._refused_before:
            _LOG.warning("refused: %s", line)
        self.refused += 1

    def _post(self, act: Callable[..., None], *arguments: object) -> None:
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop is closed: this process ends
                self._loop.call_soon_threadsafe(act, *arguments)

    def _run(self, opened: "Future[None]") -> None:
        try:
            asyncio.run(self._serve(opened))
        except Exception as error:
            if opened.done():
                _LOG.exception("the relay is down")
            else:
                opened.set_exception(error)

    async def _serve(self, opened: "Future[None]") -> None:
        over = asyncio.Event()
        await self._agent.open(lambda _: None)  # what is deleted, the agent logs
        self._loop = asyncio.get_running_loop()
        self._end = partial(self._post, over.set)
        try:
            async with asyncio.TaskGroup() as group:
                tasks = [
                    group.create_task(work()) for work in (self._receive, self._send, self._look)
                ]
                opened.set_result(None)
                await over.wait()
                for task in tasks:
                    task.cancel()
        finally:
            await self._agent.close()

    async def _receive(self) -> None:
        """Publish what bundles hold, in the order of their arrival."""
        while True:
            async with self._agent.receive() as delivery:
                await self._publish(self._read(delivery))

    def _read(self, delivery: Delivery) -> Sequence[Message]:
        if delivery.source != self._settings.ground:
            self._refuse(f"{delivery.identity} is not from {self._settings.ground}")
            return ()
        if len(delivery.payload) > LONGEST_PAYLOAD:
            self._refuse(f"{delivery.identity} has {len(delivery.payload)} octets")
            return ()
        return tuple(messages_in(delivery.payload.decode("utf-8", "replace"), self._refuse))

    async def _publish(self, commands: Sequence[Message]) -> None:
        """Publish commands until somebody has them, or something was said on each."""
        self._unanswered = frozenset(map(_key_of_command, commands))
        text, told = "".join(map(str, commands)), False
        while not self._answered() and not await asyncio.to_thread(
            self._topics.publish, text, self._answered
        ):
            if not told and not self._topics.has_listener:
                _LOG.warning("commands wait: %s", NOBODY)
                told = True
            await asyncio.sleep(PAUSE_S)

    def _answered(self) -> bool:
        """Return whether every command being published was replied to; on any thread."""
        return not self._unanswered

    def _on_notification(self, text: str) -> None:
        for message in messages_in(text, self._refuse):
            if message.moe_inputs_id is not None:
                self._unanswered -= {_key_of_reply(message)}
            if not self._queue.put(message):
                self._refuse(f"{message}: too many wait already")
        self._filled.set()

    async def _send(self) -> None:
        """Send what is queued as bundles, many in a commit, and confirm stored reports in order."""
        while True:
            await self._filled.wait()
            queued = self.health.queued if self.health else 0
            taken = self._queue.take(queued, AT_ONCE)
            if not taken:
                self._filled.clear()
            await asyncio.gather(*map(self._keep, taken))
            for number in filter(None, map(self._queue.number_of, taken)):
                self._topics.confirm(number)

    async def _keep(self, message: Message) -> None:
        measurement = self._queue.is_measurement(message)
        lifetime_s = self._settings.telemetry_lifetime_s if measurement else None
        ground = self._settings.ground
        confirm = not measurement and self._agent.must_confirm(ground)
        payload = str(message).encode("ascii")
        while True:
            try:
                await self._agent.send(ground, payload, lifetime_s=lifetime_s, confirm=confirm)
                return
            except StoreError as error:
                self._refuse(f"{message} waits: {error}")
                if measurement:
                    return
                await asyncio.sleep(LOOK_S)

    async def _look(self) -> None:
        """Measure the agent's health each second, and send it at its interval."""
        next_s = 0.0
        while True:
            self._refused_before = self.refused
            self.health = self._measure()
            if time.monotonic() >= next_s:
                next_s = time.monotonic() + self._settings.health_interval_s
                self._queue.put(health_message(self.health, self._entry, self._settings.asset))
            self._filled.set()
            await asyncio.sleep(LOOK_S)

    def _measure(self) -> LinkHealth:
        health = self.agent_health = self._agent.health()
        (orbiter,) = health.neighbours
        next_utc_s = orbiter.next_contact_utc_s
        return LinkHealth(
            utc_s=time.time(),
            queued=health.queued,
            oldest_s=health.oldest_s,
            next_contact_utc_s=next_utc_s if isfinite(next_utc_s) else None,
            last_heard_s=orbiter.last_heard_s,
            unread=health.unread,
            refused=self.refused + health.malformed,
        )


def _key_of_command(command: Message) -> _CommandKey:
    return command.source, command.moe_inputs_id, command.moe_inputs_counter


def _key_of_reply(reply: Message) -> _CommandKey:
    return reply.dest, reply.moe_inputs_id, reply.moe_inputs_counter


class SendQueue:
    """What waits to become bundles: reports all and in order, of telemetry the newest.

    Args:
        dictionary: which codes are telemetry and health.
        telemetry_queue: while more bundles than that are queued, telemetry waits.
    """

    def __init__(self, dictionary: Dictionary, telemetry_queue: int) -> None:
        self._dictionary = dictionary
        self._telemetry_queue = telemetry_queue
        spelling = dictionary.spelling
        self._measurements = {spelling.telemetry.code, spelling.link.code}
        self._reports: dict[Message, None] = {}
        self._newest: dict[int, Message] = {}

    def put(self, message: Message) -> bool:
        """Take a message; return False where there is no room for it."""
        if self.is_measurement(message):
            self._newest[message.code] = message
        elif message not in self._reports:
            if len(self._reports) >= MOST_QUEUED:
                return False
            self._reports[message] = None
        return True

    def take(self, queued: int, most: int) -> Sequence[Message]:
        """Return what is to be sent now.

        Args:
            queued: bundles that wait already.
            most: how many at most.
        """
        taken = list(islice(self._reports, most))
        for message in taken:
            del self._reports[message]
        if queued + len(taken) <= self._telemetry_queue:
            taken += self._newest.values()
            self._newest.clear()
        return taken

    def is_measurement(self, message: Message) -> bool:
        """Return whether a message is superseded by a newer one of its kind."""
        return message.code in self._measurements

    def number_of(self, message: Message) -> int | None:
        """Return the number of a report, by which it is confirmed; None if it has none."""
        try:
            sequence = report_of(message, self._dictionary, 0.0).sequence
        except MopsError:
            return None
        return None if sequence == UNNUMBERED else sequence
