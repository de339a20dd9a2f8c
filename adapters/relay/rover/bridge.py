"""`BundleBridge` of `rover-relay` between bundles and MOPS strings, on a thread of its own."""

import asyncio
import logging
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict, dataclass
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

POLL_S: Final = 1.0
PAUSE_S: Final = 0.2
REPUBLISH_S: Final = 1.0
BUNDLES_AT_ONCE: Final = 32
COMMANDS_AT_ONCE: Final = 16
"""Maximum commands in a string: a stop waits until the executive has processed the string."""
STRINGS_IN_FLIGHT: Final = 2
"""Maximum unconfirmed strings of commands: the next is processed while one is confirmed."""
REPORTS_AT_ONCE: Final = 100
MAX_FUTURE_STOP_S: Final = 600.0
"""Time during which a stop from a fast clock overtakes later commands; chosen, not measured."""
MAX_PAYLOAD_OCTETS: Final = 65_536
MAX_QUEUED_REPORTS: Final = 10_000
"""Strings of reports that wait while the store is full; more are refused."""
NO_SUBSCRIBER_TEXT: Final = "no subscriber, neither rover-executive with --relay nor rover-nxt"
_LOG: Final = logging.getLogger(__name__)


class RoverTopics(Protocol):
    """ROS topics as used by the bridge, on the thread of its loop."""

    def publish(self, text: str, *, stops: bool) -> None:
        """Publish commands, as whole messages; stops use a topic of their own."""
        ...

    def has_listener(self, *, stops: bool) -> bool:
        """Whether the topic has a subscriber."""
        ...

    def confirm(self, mark: int) -> None:
        """Publish the fingerprint of a string that is on the disk."""
        ...


CreationTime = tuple[int, int, int]
"""Creation time of a command: the bundle's milliseconds since 2000 and sequence number (RFC 9171,
4.2.7), and the index of the command in the bundle."""


@dataclass(frozen=True, slots=True)
class BundledCommand:
    """A command from a bundle."""

    message: Message
    creation: CreationTime


class BundleBridge:
    """Sends each string as a bundle, and publishes the content of bundles, at least once.

    A bundle counts as delivered once the receiver of its commands has confirmed their string.
    Until then the string is republished: the rover's ledger, or the brick's record, identifies a
    command by source and number, and executes it once.

    A stop overtakes everything that waits here. Commands made before the last stop are published
    with a mark that a stop overtook them, so that none of them moves the rover after the stop. They
    are not refused here: an earlier process, or the direct link, may have delivered the command,
    and only its receiver knows whether it has ended already.

    Args:
        settings: endpoints and links.
        path: file of the bundle store.
        plan: contact plan; None for permanent contact.
        dictionary: MOPS formats of the messages.
        topics: publishes the strings.
        security: signs and verifies bundles; None disables both.
        system: its clock, disk and sockets.

    Attributes:
        health: state of the link at the latest poll, as sent to the ground.
        refused: messages and bundles that were not forwarded.
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
        self._saving = asyncio.Lock()
        self._in_flight = asyncio.Semaphore(STRINGS_IN_FLIGHT)
        # Two bundles may hold the same stop: both wait for the string's one event.
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
            OSError: an address cannot be bound.
        """
        opened: Future[None] = Future()
        self._thread = threading.Thread(
            target=self._run, args=(opened,), name="bundles", daemon=True
        )
        self._thread.start()
        opened.result()

    def close(self) -> None:
        """Close the agent; queued bundles are retained."""
        if self._thread is not None:
            self._end()
            self._thread.join()

    def notify(self, text: str) -> None:
        """Queue messages for the ground; callable from any thread."""
        self._post(self._on_notification, text)

    def on_confirmed(self, mark: int) -> None:
        """Mark a string of commands as confirmed; callable from any thread."""
        self._post(self._on_confirmed, mark)

    def set_plan(self, plan: ContactPlan | None) -> None:
        """Replace the contact plan; callable from any thread."""
        self._post(self._agent.set_plan, plan)

    def _refuse(self, line: str) -> None:
        """Count a message that is not forwarded; log the first since the latest poll."""
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
            opened: completed once it serves.
        """
        over = asyncio.Event()
        await self._agent.open(lambda _: None)  # the agent logs deletions
        self._loop = asyncio.get_running_loop()
        self._end = partial(self._post, over.set)
        try:
            async with asyncio.TaskGroup() as group:
                work = (
                    self._receive(only_expedited=True),
                    self._receive(only_expedited=False),
                    self._send(),
                    self._poll(),
                )
                tasks = [group.create_task(each) for each in work]
                opened.set_result(None)
                await over.wait()
                for task in tasks:
                    task.cancel()
        finally:
            await self._agent.close()

    async def _receive(self, *, only_expedited: bool) -> None:
        """Pass on the content of bundles in order of arrival, stops first."""
        while True:
            async with self._agent.receive_some(
                BUNDLES_AT_ONCE, only_expedited=only_expedited
            ) as deliveries:
                commands = [each for delivery in deliveries for each in self._read(delivery)]
                stops = [each for each in commands if self._dictionary.is_stop(each.message)]
                if stops:
                    self._last_stop.add_stop(max(each.creation for each in stops))
                    await self._hand_over(stops, stops=True)
                    async with self._saving:
                        await asyncio.to_thread(self._last_stop.save)
                others = [each for each in commands if not self._dictionary.is_stop(each.message)]
                async with asyncio.TaskGroup() as group:
                    for first in range(0, len(others), COMMANDS_AT_ONCE):
                        await self._in_flight.acquire()
                        some = others[first : first + COMMANDS_AT_ONCE]
                        handing_over = group.create_task(self._hand_over(some, stops=False))
                        handing_over.add_done_callback(lambda _: self._in_flight.release())

    def _read(self, delivery: Delivery) -> Iterator[BundledCommand]:
        if delivery.source != self._settings.ground:
            self._refuse(f"{delivery.identity} is not from {self._settings.ground}")
        elif len(delivery.payload) > MAX_PAYLOAD_OCTETS:
            self._refuse(f"{delivery.identity} has {len(delivery.payload)} octets")
        else:
            creation = delivery.identity.creation
            text = delivery.payload.decode("utf-8", "replace")
            for index, message in enumerate(messages_in(text, self._refuse)):
                yield BundledCommand(message, (creation.time_ms, creation.sequence, index))

    async def _hand_over(self, bundled: Sequence[BundledCommand], *, stops: bool) -> None:
        """Publish commands until they are confirmed; mark those that a stop has overtaken."""
        logged = False
        while True:
            text = "".join(map(self._text_of, bundled))
            if not text:
                return
            has_subscriber = self._topics.has_listener(stops=stops)
            if has_subscriber:
                self._topics.publish(text, stops=stops)
            elif not logged:
                _LOG.warning("commands wait: %s", NO_SUBSCRIBER_TEXT)
                logged = True
            if await self._is_confirmed(
                fingerprint(text), REPUBLISH_S if has_subscriber else PAUSE_S
            ):
                return

    async def _is_confirmed(self, mark: int, within_s: float) -> bool:
        confirmed = self._unconfirmed.setdefault(mark, asyncio.Event())
        try:
            async with asyncio.timeout(within_s):
                await confirmed.wait()
        except TimeoutError:
            return False
        return True

    def _text_of(self, bundled: BundledCommand) -> str:
        """Return the present form of a command; empty if the mark does not fit into it."""
        message = bundled.message
        if self._dictionary.is_stop(message) or not self._last_stop.overtakes(bundled.creation):
            return str(message)
        try:
            return str(mark_overtaken(message))
        except MopsError as error:
            self._refuse(f"{message}: overtaken by a stop, but the mark does not fit: {error}")
            return ""

    def _on_confirmed(self, mark: int) -> None:
        if (confirmed := self._unconfirmed.get(mark)) is not None:
            confirmed.set()

    def _on_notification(self, text: str) -> None:
        if not self._queue.put(text, self._refuse):
            self._refuse(f"{text}: the queue of reports is full")
        self._filled.set()

    async def _send(self) -> None:
        """Send the queue as bundles, many in a commit, and confirm reports that are stored."""
        while True:
            await self._filled.wait()
            queued = self.health.queued if self.health else 0
            reports, measurements = self._queue.pop(queued, REPORTS_AT_ONCE)
            if not reports and not measurements:
                self._filled.clear()
            await asyncio.gather(
                *(self._store(each.text) for each in reports),
                *(self._send_measurement(str(each)) for each in measurements),
            )
            for each in reports:
                self._topics.confirm(each.mark)

    async def _store(self, reports: str) -> None:
        """Send reports; retry while the store is full."""
        ground = self._settings.ground
        confirm = self._agent.must_confirm(ground)
        while True:
            try:
                await self._agent.send(ground, reports.encode("ascii"), confirm=confirm)
                return
            except StoreError as error:
                self._refuse(f"{reports} waits: {error}")
                await asyncio.sleep(POLL_S)

    async def _send_measurement(self, message: str) -> None:
        lifetime_s = self._settings.telemetry_lifetime_s
        try:
            await self._agent.send(
                self._settings.ground, message.encode("ascii"), lifetime_s=lifetime_s
            )
        except StoreError as error:
            self._refuse(f"{message}: {error}")

    async def _poll(self) -> None:
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
            await asyncio.sleep(POLL_S)

    def _measure(self) -> LinkHealth:
        health = self.agent_health = self._agent.health()
        (orbiter,) = health.neighbours
        next_utc_s = orbiter.next_contact_utc_s
        return LinkHealth(
            utc_s=self._system.utc_s(),
            queued=health.queued,
            oldest_age_s=health.oldest_age_s,
            next_contact_utc_s=next_utc_s if isfinite(next_utc_s) else None,
            last_received_s=orbiter.last_received_s,
            undelivered=health.undelivered,
            refused=self.refused + health.malformed + health.refused,
            contact=orbiter.contact,
            queued_octets=self._agent.queued_octets(orbiter.node),
            **asdict(orbiter.traffic),
        )


class LastStop:
    """Creation time of the last stop, over restarts; earlier commands must not move the rover.

    Both times are those of the orbiter's clock. If that clock was ahead and is then corrected,
    later commands seem older than the stop. Therefore commands created after the arrival of the
    stop count as overtaken for `MAX_FUTURE_STOP_S` only.
    """

    def __init__(self, path: Path, system: System = OPERATING_SYSTEM) -> None:
        self._path, self._system = path, system
        self._made: CreationTime = (0, 0, 0)
        self._arrived_ms = 0
        with suppress(OSError, ValueError):
            time_ms, sequence, index, self._arrived_ms = map(int, path.read_text("ascii").split())
            self._made = (time_ms, sequence, index)

    def add_stop(self, made: CreationTime) -> None:
        """Record a stop that has arrived."""
        if made > self._made:
            self._made, self._arrived_ms = made, self._now_ms

    def overtakes(self, made: CreationTime) -> bool:
        """Return whether a stop has overtaken a command with this creation time."""
        if made >= self._made:
            return False
        self._arrived_ms = min(self._arrived_ms, self._now_ms)  # the clock here was set back
        held = self._now_ms - self._arrived_ms < MAX_FUTURE_STOP_S * 1000
        return held or made[0] <= self._arrived_ms

    def save(self) -> None:
        """Save it atomically; if that fails it applies until a restart."""
        text = " ".join(map(str, (*self._made, self._arrived_ms)))
        try:
            self._system.replace(self._path, f"{text}\n".encode("ascii"))
        except OSError as error:
            _LOG.error("last stop not saved: %s", error)

    @property
    def _now_ms(self) -> int:
        return round(self._system.utc_s() * 1000) - DTN_EPOCH_UTC_MS


@dataclass(frozen=True, slots=True)
class ReportBatch:
    """Reports that are sent in one bundle.

    Attributes:
        mark: fingerprint of the string that contained them.
    """

    text: str
    mark: int


class SendQueue:
    """Queue of messages that become bundles: all reports in order, and the newest telemetry.

    Args:
        dictionary: defines the codes of telemetry and health.
        telemetry_queue: telemetry is held back while more bundles than this wait.
    """

    def __init__(self, dictionary: Dictionary, telemetry_queue: int) -> None:
        self._telemetry_queue = telemetry_queue
        spelling = dictionary.spelling
        self._measurements = {
            spelling.telemetry.code,
            spelling.link.code,
            spelling.housekeeping.code,
            spelling.questions.code,
        }
        self._reports: dict[ReportBatch, None] = {}
        self._newest: dict[int, Message] = {}

    def put(self, text: str, refuse: Callable[[str], None]) -> bool:
        """Queue a string of messages; return False if the queue of reports is full.

        Args:
            text: the string.
            refuse: called with each piece that is not a message.
        """
        dropped: list[str] = []
        messages = list(messages_in(text, dropped.append))
        for line in dropped:
            refuse(line)
        reports = [each for each in messages if each.code not in self._measurements]
        self._newest |= {each.code: each for each in messages if each.code in self._measurements}
        if reports:
            if len(self._reports) >= MAX_QUEUED_REPORTS:
                return False
            whole = len(reports) == len(messages) and not dropped
            part = text if whole else "".join(map(str, reports))
            self._reports[ReportBatch(part, fingerprint(text))] = None
        return True

    def pop(self, queued: int, maximum: int) -> tuple[Sequence[ReportBatch], Sequence[Message]]:
        """Return the reports and the measurements that are due now.

        Args:
            queued: number of bundles that wait already.
            maximum: maximum number of strings of reports.
        """
        reports = list(islice(self._reports, maximum))
        for each in reports:
            del self._reports[each]
        newest: list[Message] = []
        if queued + len(reports) <= self._telemetry_queue:
            newest += self._newest.values()
            self._newest.clear()
        return reports, newest
