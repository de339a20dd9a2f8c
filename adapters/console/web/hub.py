"""`Hub` sends messages to the pages in batches; only telemetry may be dropped.

Messages other than telemetry are numbered, and buffered for pages that reconnect. The last message
on each subject is stored for new pages.
"""

import asyncio
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final, assert_never

from adapters.console.messages import (
    PROTOCOL,
    AlarmStatus,
    AssetState,
    AuthorityMessage,
    Broadcast,
    CommandStatus,
    DictionaryChanged,
    FileChanged,
    Hello,
    Latest,
    LinkStatus,
    Message,
    NotificationMessage,
    ObjectChanged,
    OpenPage,
    PlanProgress,
    PosePrediction,
    Presence,
    Quality,
    QuestionStatus,
    Sample,
    SamplesDropped,
    StopState,
    StopStatus,
    Transfer,
    TransferState,
    TreeState,
    encode,
    is_wanted,
    topic_of,
)
from adapters.system import System

BATCH_S: Final = 0.05
"""Minimum interval between two batches to a page, s."""
GATHER_S: Final = 0.005
"""Time after the first message in which further ones join its batch, s."""
MAX_QUEUED_SAMPLES: Final = 2000
"""Capacity of a page's telemetry queue; beyond it the first values are dropped."""
MAX_QUEUED: Final = 20_000
"""Capacity of a page's message queue; beyond it the page must reconnect and resume."""
REPLAY_BUFFER: Final = 20_000
"""Capacity of the buffer of messages that can be resent."""
MAX_REPLAYED_COMMANDS: Final = 500
"""Maximum number of commands sent to a new page."""


class PageConnection:
    """Queues of one open page.

    Args:
        hub: the hub that serves it.
        present: its name, operator, and start time.

    Attributes:
        too_slow: whether its message queue overflowed and was cleared.
    """

    def __init__(self, hub: "Hub", present: OpenPage) -> None:
        self._hub, self.present = hub, present
        self.too_slow = False
        self._topics: frozenset[str] = frozenset()
        self._waiting: deque[str] = deque()
        self._samples: deque[str] = deque(maxlen=MAX_QUEUED_SAMPLES)
        self._latest: dict[str, str] = {}
        self._dropped = 0
        self._wake = asyncio.Event()
        self._sent_s = -BATCH_S

    def subscribe(self, topics: Iterable[str]) -> None:
        """Set the subscribed topics, and queue the latest messages of new topics."""
        before, self._topics = self._topics, frozenset(topics)
        for message in self._hub.latest_messages():
            topic = topic_of(message)
            if is_wanted(topic, self._topics) and not is_wanted(topic, before):
                self.put(message, encode(message))

    def resume(self, topics: Iterable[str], since: int) -> None:
        """Set the subscribed topics; queue messages after a number, and the latest telemetry."""
        self._topics = frozenset(topics)
        for topic, text in self._hub.since(since):
            if is_wanted(topic, self._topics):
                self._put(text)
        for message in self._hub.latest_messages():
            if isinstance(message, Sample | Latest) and self.is_subscribed(topic_of(message)):
                self.put(message, encode(message))

    def is_subscribed(self, topic: str) -> bool:
        """Whether the page is subscribed to a topic."""
        return is_wanted(topic, self._topics)

    def put(self, message: Message, text: str) -> None:
        """Queue a message. Telemetry may be dropped; a complete state replaces the previous one."""
        if isinstance(message, Latest):
            self._latest[topic_of(message)] = text
            self._wake.set()
            return
        if not isinstance(message, Sample):
            self._put(text)
            return
        if len(self._samples) == MAX_QUEUED_SAMPLES:
            self._dropped += 1
            self._hub.dropped += 1
        self._samples.append(text)
        self._wake.set()

    async def batch(self) -> str:
        """Wait for messages, and return the next batch as one JSON array."""
        await self._wake.wait()
        now_s = asyncio.get_running_loop().time
        await asyncio.sleep(max(GATHER_S, self._sent_s + BATCH_S - now_s()))
        self._sent_s = now_s()
        self._wake.clear()
        texts = [*self._waiting, *self._samples, *self._latest.values()]
        if self._dropped:
            texts.append(encode(SamplesDropped(self._dropped)))
        self._waiting.clear()
        self._samples.clear()
        self._latest.clear()
        self._dropped = 0
        return f"[{','.join(texts)}]"

    def _put(self, text: str) -> None:
        if len(self._waiting) >= MAX_QUEUED:
            self.too_slow = True
            self._waiting.clear()
        self._waiting.append(text)
        self._wake.set()


class Hub:
    """Sends messages to all subscribed pages.

    Args:
        system: clock and random ids.

    Attributes:
        instance: id of this process start; message numbers are valid within it only.
        dropped: number of telemetry values dropped for slow pages.
    """

    def __init__(self, system: System) -> None:
        self.instance = system.random_octets(8).hex()
        self.dropped = 0
        self._utc = system.utc_s
        self._seq = 0
        self._replay_buffer: deque[tuple[str, str]] = deque(maxlen=REPLAY_BUFFER)
        self._standing: dict[tuple[object, ...], Message] = {}
        self._commands: dict[tuple[str, str, int], CommandStatus] = {}
        self._pages: list[PageConnection] = []
        self._others: tuple[OpenPage, ...] = ()

    def publish(self, message: Broadcast) -> None:
        """Send a message to subscribed pages, also after their reconnection."""
        self._seq += 1
        topic, text = topic_of(message), encode(message, self._seq)
        self._replay_buffer.append((topic, text))
        self._store_for_replay(message)
        for page in self._pages:
            if page.is_subscribed(topic):
                page.put(message, text)

    def sample(self, sample: Sample) -> None:
        """Send a telemetry value to subscribed pages."""
        if sample.q is not Quality.LATE:
            self._standing[sample.ty, sample.asset, sample.key, sample.link] = sample
        self._send(sample)

    def state(self, state: TreeState | PosePrediction) -> None:
        """Send a tree or a prediction to subscribed pages."""
        self._standing[state.ty, state.asset] = state
        self._send(state)

    def transfer(self, transfer: Transfer) -> None:
        """Send the status of a transfer to subscribed pages."""
        key = (transfer.ty, transfer.asset, transfer.id)
        if transfer.state is TransferState.REMOVED:
            self._standing.pop(key, None)
        else:
            self._standing[key] = transfer
        self._send(transfer)

    def _send(self, message: Sample | Latest) -> None:
        topic, text = topic_of(message), ""
        for page in self._pages:
            if page.is_subscribed(topic):
                text = text or encode(message)
                page.put(message, text)

    def open(self, console: str, operator: str) -> PageConnection:
        """Create the queues of a new page, and publish the presence."""
        page = PageConnection(self, OpenPage(console, operator, self._utc()))
        self._pages.append(page)
        self._publish_presence()
        return page

    def close(self, page: PageConnection) -> None:
        """Remove a page, and publish the presence."""
        self._pages.remove(page)
        self._publish_presence()

    def publish_other_pages(self, pages: tuple[OpenPage, ...]) -> None:
        """Publish the open pages of other consoles, if changed."""
        if pages != self._others:
            self._others = pages
            self._publish_presence()

    @property
    def pages(self) -> tuple[OpenPage, ...]:
        """The open pages of this console."""
        return tuple(page.present for page in self._pages)

    def is_present(self, operator: str) -> bool:
        """Whether an operator has an open page at this console."""
        return any(page.present.operator == operator for page in self._pages)

    def hello(self, page: PageConnection, *, resumed: bool) -> Hello:
        """Return the first message to a page."""
        operator = page.present.operator
        return Hello(PROTOCOL, self.instance, self._seq, self._utc(), operator, resumed)

    def can_resume(self, instance: object, seq: object) -> bool:
        """Whether all messages after a number can be resent."""
        first = self._seq - len(self._replay_buffer)
        return instance == self.instance and isinstance(seq, int) and first <= seq <= self._seq

    def since(self, seq: int) -> Iterator[tuple[str, str]]:
        """Yield topic and text of each message after a number."""
        return islice(self._replay_buffer, len(self._replay_buffer) - (self._seq - seq), None)

    def latest_messages(self) -> tuple[Message, ...]:
        """Return the last message on each subject; commands in the order of their creation."""
        return (*self._standing.values(), *self._commands.values())

    def _publish_presence(self) -> None:
        self.publish(Presence((*self.pages, *self._others)))

    def _store_for_replay(self, message: Broadcast) -> None:
        match message:
            case CommandStatus(asset=asset, source=source, number=number):
                self._commands[asset, source, number] = message
                if len(self._commands) > MAX_REPLAYED_COMMANDS:
                    del self._commands[next(iter(self._commands))]
            case NotificationMessage() | FileChanged() | ObjectChanged():
                pass
            case Presence():
                self._standing[message.ty,] = message
            case AlarmStatus(id=number):
                self._standing[message.ty, number] = message
                if not message.open:
                    del self._standing[message.ty, number]
            case LinkStatus(uri=uri):
                self._standing.pop((message.ty, uri), None)  # an asset may move to another address
                self._standing[message.ty, uri] = message
            case AssetState(asset=asset, link=link) | AuthorityMessage(asset=asset, link=link):
                self._standing[message.ty, asset, link] = message
            case StopStatus(asset=asset, state=state):
                self._standing[message.ty, asset] = message
                if state is not StopState.WAITING:
                    del self._standing[message.ty, asset]
            case PlanProgress(asset=asset, plan=plan):
                self._standing[message.ty, asset, plan] = message
            case QuestionStatus(asset=asset, plan=plan, question=key, end=end):
                self._standing[message.ty, asset, plan, key] = message
                if end is not None:
                    del self._standing[message.ty, asset, plan, key]
            case DictionaryChanged(asset=asset):
                self._standing[message.ty, asset] = message
            case _:
                assert_never(message)
