"""The bridge of `rover-relay` between bundles and MOPS strings, on a thread and loop of its own."""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import isfinite
from pathlib import Path
from typing import Final, Protocol
from weakref import WeakValueDictionary

from adapters.bundle import (
    DTN_EPOCH_UTC_MS,
    BundleAgent,
    ContactPlan,
    Delivery,
    Health,
    Security,
    StoreError,
)
from adapters.mops import (
    Dictionary,
    LinkHealth,
    Message,
    MopsError,
    fingerprint,
    health_message,
    mark_overtaken,
    messages_in,
)
from adapters.relay.rover.settings import RelaySettings
from adapters.system import OPERATING_SYSTEM, System

LOOK_S: Final = 1.0
PAUSE_S: Final = 0.2
AGAIN_S: Final = 1.0
BUNDLES_AT_ONCE: Final = 32
COMMANDS_AT_ONCE: Final = 16
"""So few that the executive, which takes them in one piece of work, is soon there for a stop."""
STRINGS_IN_FLIGHT: Final = 2
"""Strings of commands that are not confirmed: while one is confirmed, the next is worked on."""
REPORTS_AT_ONCE: Final = 100
MOST_HELD_S: Final = 600.0
"""How long a stop of a clock that is ahead refuses what that clock, set right, makes after it."""
LONGEST_PAYLOAD: Final = 65_536
MOST_QUEUED: Final = 10_000
"""Strings of reports that wait for a store that is full; more are refused."""
NOBODY: Final = "nobody listens for them, neither rover-executive with --relay nor rover-nxt"
_LOG: Final = logging.getLogger(__name__)


class RoverTopics(Protocol):
    """The ROS topics, as the bridge uses them, on the thread of its loop."""

    def publish(self, text: str, *, stops: bool) -> None:
        """Publish commands, whole messages; stops go on a topic of their own."""
        ...

    def has_listener(self, *, stops: bool) -> bool:
        """Whether somebody listens."""
        ...

    def confirm(self, mark: int) -> None:
        """Say that the string of this fingerprint is on the disk."""
        ...


Made = tuple[int, int, int]
"""When a command was made: the bundle's milliseconds since 2000, its number within them, and the
command's place in it."""


@dataclass(frozen=True, slots=True)
class BundledCommand:
    """A command that a bundle held."""

    message: Message
    made: Made


class BundleBridge:
    """Sends each string as a bundle, and publishes what bundles hold, at least once.

    A bundle counts as delivered once who takes its commands has confirmed their string. Until then
    it is published again: the rover's ledger, or the brick's record, knows a command by its source
    and number and executes it once.

    A stop overtakes all that wait here. What was made before the last stop is published with the
    mark that a stop overtook it, so that nothing moves the rover after a stop that was asked for
    before it. It is not refused here: an earlier process, or the direct link, may have handed the
    command over, and only who takes it knows whether it has an end already.

    Args:
        settings: endpoints and links.
        path: the store of the bundles.
        plan: planned contacts; None for always.
        dictionary: how messages are spelled.
        topics: where strings leave.
        security: signs and verifies the bundles; None for neither.
        system: its clock, disk and sockets.

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
        security: Security | None = None,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._settings, self._topics, self._system = settings, topics, system
        self._entry = dictionary.spelling.link
        self._agent = BundleAgent(
            settings.node(), path, settings.listen, plan,
            daemon=settings.daemon, security=security, system=system,
        )  # fmt: skip
        self._queue = SendQueue(dictionary, settings.telemetry_queue)
        self._filled = asyncio.Event()
        self._dictionary = dictionary
        self._last_stop = LastStop(path.with_suffix(".stop"), system)
        self._in_flight = asyncio.Semaphore(STRINGS_IN_FLIGHT)
        # Two bundles may hold the same stop: whoever waits for its string shares one event.
        self._unconfirmed = WeakValueDictionary[int, asyncio.Event]()
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
        self._thread = threading.Thread(
            target=self._run, args=(opened,), name="bundles", daemon=True
        )
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

    def confirmed(self, mark: int) -> None:
        """Take a string of commands for taken; from any thread."""
        self._post(self._on_confirmed, mark)

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
            asyncio.run(self.serve(opened))
        except Exception as error:
            if opened.done():
                _LOG.exception("the relay is down")
            else:
                opened.set_exception(error)

    async def serve(self, opened: "Future[None]") -> None:
        """Open the agent on the running loop, and serve until it is closed.

        Args:
            opened: completes once it serves.
        """
        over = asyncio.Event()
        await self._agent.open(lambda _: None)  # what is deleted, the agent logs
        self._loop = asyncio.get_running_loop()
        self._end = partial(self._post, over.set)
        try:
            async with asyncio.TaskGroup() as group:
                work = (
                    self._receive(only_expedited=True),
                    self._receive(only_expedited=False),
                    self._send(),
                    self._look(),
                )
                tasks = [group.create_task(each) for each in work]
                opened.set_result(None)
                await over.wait()
                for task in tasks:
                    task.cancel()
        finally:
            await self._agent.close()

    async def _receive(self, *, only_expedited: bool) -> None:
        """Hand over what bundles hold in the order of their arrival, a stop before all else."""
        while True:
            async with self._agent.receive_some(
                BUNDLES_AT_ONCE, only_expedited=only_expedited
            ) as deliveries:
                asked = [each for delivery in deliveries for each in self._read(delivery)]
                stops = [each for each in asked if self._dictionary.is_stop(each.message)]
                if stops:
                    self._last_stop.take(max(each.made for each in stops))
                    await self._hand_over(stops, stops=True)
                    self._last_stop.keep()
                others = [each for each in asked if not self._dictionary.is_stop(each.message)]
                async with asyncio.TaskGroup() as group:
                    for first in range(0, len(others), COMMANDS_AT_ONCE):
                        await self._in_flight.acquire()
                        some = others[first : first + COMMANDS_AT_ONCE]
                        handing_over = group.create_task(self._hand_over(some, stops=False))
                        handing_over.add_done_callback(lambda _: self._in_flight.release())

    def _read(self, delivery: Delivery) -> Iterator[BundledCommand]:
        if delivery.source != self._settings.ground:
            self._refuse(f"{delivery.identity} is not from {self._settings.ground}")
        elif len(delivery.payload) > LONGEST_PAYLOAD:
            self._refuse(f"{delivery.identity} has {len(delivery.payload)} octets")
        else:
            creation = delivery.identity.creation
            text = delivery.payload.decode("utf-8", "replace")
            for place, message in enumerate(messages_in(text, self._refuse)):
                yield BundledCommand(message, (creation.time_ms, creation.sequence, place))

    async def _hand_over(self, asked: Sequence[BundledCommand], *, stops: bool) -> None:
        """Publish commands until they are confirmed; mark those that a stop has overtaken."""
        told = False
        while True:
            text = "".join(map(self._text_of, asked))
            if not text:
                return
            heard = self._topics.has_listener(stops=stops)
            if heard:
                self._topics.publish(text, stops=stops)
            elif not told:
                _LOG.warning("commands wait: %s", NOBODY)
                told = True
            if await self._is_confirmed(fingerprint(text), AGAIN_S if heard else PAUSE_S):
                return

    async def _is_confirmed(self, mark: int, within_s: float) -> bool:
        confirmed = self._unconfirmed.setdefault(mark, asyncio.Event())
        try:
            async with asyncio.timeout(within_s):
                await confirmed.wait()
        except TimeoutError:
            return False
        return True

    def _text_of(self, asked: BundledCommand) -> str:
        """Return a command as it is published now; empty where the mark has no room in it."""
        message = asked.message
        if self._dictionary.is_stop(message) or not self._last_stop.overtakes(asked.made):
            return str(message)
        try:
            return str(mark_overtaken(message))
        except MopsError as error:
            self._refuse(f"{message}: a stop has overtaken it, and it cannot say so: {error}")
            return ""

    def _on_confirmed(self, mark: int) -> None:
        if (confirmed := self._unconfirmed.get(mark)) is not None:
            confirmed.set()

    def _on_notification(self, text: str) -> None:
        if not self._queue.put(text, self._refuse):
            self._refuse(f"{text}: too many wait already")
        self._filled.set()

    async def _send(self) -> None:
        """Send what is queued as bundles, many in a commit, and confirm reports that are stored."""
        while True:
            await self._filled.wait()
            queued = self.health.queued if self.health else 0
            reports, measurements = self._queue.take(queued, REPORTS_AT_ONCE)
            if not reports and not measurements:
                self._filled.clear()
            await asyncio.gather(
                *(self._keep(each.text) for each in reports),
                *(self._send_measurement(str(each)) for each in measurements),
            )
            for each in reports:
                self._topics.confirm(each.mark)

    async def _keep(self, reports: str) -> None:
        """Send reports, however long there is no room for them."""
        ground = self._settings.ground
        confirm = self._agent.must_confirm(ground)
        while True:
            try:
                await self._agent.send(ground, reports.encode("ascii"), confirm=confirm)
                return
            except StoreError as error:
                self._refuse(f"{reports} waits: {error}")
                await asyncio.sleep(LOOK_S)

    async def _send_measurement(self, message: str) -> None:
        lifetime_s = self._settings.telemetry_lifetime_s
        try:
            await self._agent.send(
                self._settings.ground, message.encode("ascii"), lifetime_s=lifetime_s
            )
        except StoreError as error:
            self._refuse(f"{message}: {error}")

    async def _look(self) -> None:
        """Measure the agent's health each second, and send it at its interval."""
        now_s, next_s = self._system.now_s, 0.0
        while True:
            self._refused_before = self.refused
            self.health = self._measure()
            if now_s() >= next_s:
                next_s = now_s() + self._settings.health_interval_s
                message = health_message(self.health, self._entry, self._settings.asset)
                self._queue.put(str(message), self._refuse)
            self._filled.set()
            await asyncio.sleep(LOOK_S)

    def _measure(self) -> LinkHealth:
        health = self.agent_health = self._agent.health()
        (orbiter,) = health.neighbours
        next_utc_s, traffic = orbiter.next_contact_utc_s, orbiter.traffic
        return LinkHealth(
            utc_s=self._system.utc_s(),
            queued=health.queued,
            oldest_s=health.oldest_s,
            next_contact_utc_s=next_utc_s if isfinite(next_utc_s) else None,
            last_heard_s=orbiter.last_heard_s,
            unread=health.unread,
            refused=self.refused + health.malformed + health.refused,
            contact=orbiter.contact,
            queued_octets=self._agent.queued_octets(orbiter.node),
            sent=traffic.sent,
            acknowledged=traffic.acknowledged,
            retransmitted=traffic.retransmitted,
            expired=traffic.expired,
            received=traffic.received,
            round_trip_s=traffic.round_trip_s,
        )


class LastStop:
    """The last stop, over restarts: what was made before it is not to move the rover after it.

    Both times are of the orbiter's clock. Where that was ahead of the clock here, what is made once
    it is right would seem to be older than the stop, too: what was made after the stop had arrived
    counts as overtaken for `MOST_HELD_S` only.
    """

    def __init__(self, path: Path, system: System = OPERATING_SYSTEM) -> None:
        self._path, self._system = path, system
        self._made: Made = (0, 0, 0)
        self._arrived_ms = 0
        with suppress(OSError, ValueError):
            time_ms, sequence, place, self._arrived_ms = map(int, path.read_text("ascii").split())
            self._made = (time_ms, sequence, place)

    def take(self, made: Made) -> None:
        """Take a stop that has arrived."""
        if made > self._made:
            self._made, self._arrived_ms = made, self._now_ms

    def overtakes(self, made: Made) -> bool:
        """Return whether what was made then is not to be handed over any more."""
        if made >= self._made:
            return False
        self._arrived_ms = min(self._arrived_ms, self._now_ms)  # the clock here was set back
        held = self._now_ms - self._arrived_ms < MOST_HELD_S * 1000
        return held or made[0] <= self._arrived_ms

    def keep(self) -> None:
        """Write it down, whole or not at all; where that fails it holds until a restart."""
        text = " ".join(map(str, (*self._made, self._arrived_ms)))
        try:
            self._system.replace(self._path, f"{text}\n".encode("ascii"))
        except OSError as error:
            _LOG.error("the last stop is not written down: %s", error)

    @property
    def _now_ms(self) -> int:
        return round(self._system.utc_s() * 1000) - DTN_EPOCH_UTC_MS


@dataclass(frozen=True, slots=True)
class ReportBatch:
    """Reports that go up in one bundle.

    Attributes:
        text: their messages.
        mark: the fingerprint of the string in which they came.
    """

    text: str
    mark: int


class SendQueue:
    """What waits to become bundles: reports all and in order, of telemetry the newest.

    Args:
        dictionary: which codes are telemetry and health.
        telemetry_queue: while more bundles than that are queued, telemetry waits.
    """

    def __init__(self, dictionary: Dictionary, telemetry_queue: int) -> None:
        self._telemetry_queue = telemetry_queue
        spelling = dictionary.spelling
        self._measurements = {
            spelling.telemetry.code,
            spelling.link.code,
            spelling.housekeeping.code,
        }
        self._reports: dict[ReportBatch, None] = {}
        self._newest: dict[int, Message] = {}

    def put(self, text: str, refuse: Callable[[str], None]) -> bool:
        """Take a string of messages; return False where there is no room for its reports.

        Args:
            text: what came.
            refuse: is told of each piece that is no message.
        """
        dropped: list[str] = []
        messages = list(messages_in(text, dropped.append))
        for line in dropped:
            refuse(line)
        reports = [each for each in messages if each.code not in self._measurements]
        self._newest |= {each.code: each for each in messages if each.code in self._measurements}
        if reports:
            if len(self._reports) >= MOST_QUEUED:
                return False
            whole = len(reports) == len(messages) and not dropped
            kept = text if whole else "".join(map(str, reports))
            self._reports[ReportBatch(kept, fingerprint(text))] = None
        return True

    def take(self, queued: int, most: int) -> tuple[Sequence[ReportBatch], Sequence[Message]]:
        """Return the reports and the measurements that are to be sent now.

        Args:
            queued: bundles that wait already.
            most: how many strings of reports at most.
        """
        reports = list(islice(self._reports, most))
        for each in reports:
            del self._reports[each]
        newest: list[Message] = []
        if queued + len(reports) <= self._telemetry_queue:
            newest += self._newest.values()
            self._newest.clear()
        return reports, newest
