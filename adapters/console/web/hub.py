"""What goes to the pages: messages in batches, telemetry that may be dropped, the rest never.

What is not telemetry is numbered, and kept for pages that come back after a loss of their
connection. The last message on each thing is kept for pages that are new.
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
    Notified,
    ObjectChanged,
    OpenPage,
    PlanProgress,
    Presence,
    Quality,
    Sample,
    SamplesDropped,
    Transfer,
    TransferState,
    TreeState,
    encode,
    is_wanted,
    topic_of,
)
from adapters.system import System

BATCH_S: Final = 0.05
"""Between two batches to a page, at least."""
GATHER_S: Final = 0.005
"""What comes so soon after the first message goes with it."""
MOST_SAMPLES: Final = 2000
"""Telemetry values that wait for a slow page; then the oldest are dropped."""
MOST_WAITING: Final = 20_000
"""Other messages that wait for a slow page; then it has to come again, and resume."""
KEPT: Final = 20_000
"""Messages that can be sent again."""
KEPT_COMMANDS: Final = 500
"""Commands that a new page is told of."""


class PageConnection:
    """What waits for one open page.

    Args:
        hub: what it is one of.
        present: its name, who is at it, and since when.

    Attributes:
        too_slow: whether more waits than may; what waits is gone then.
    """

    def __init__(self, hub: "Hub", present: OpenPage) -> None:
        self._hub, self.present = hub, present
        self.too_slow = False
        self._topics: frozenset[str] = frozenset()
        self._waiting: deque[str] = deque()
        self._samples: deque[str] = deque(maxlen=MOST_SAMPLES)
        self._latest: dict[str, str] = {}
        self._dropped = 0
        self._something = asyncio.Event()
        self._sent_s = -BATCH_S

    def subscribe(self, topics: Iterable[str]) -> None:
        """Get what belongs to these topics from now on, and of those that are new how it stands."""
        before, self._topics = self._topics, frozenset(topics)
        for message in self._hub.standing():
            topic = topic_of(message)
            if is_wanted(topic, self._topics) and not is_wanted(topic, before):
                self.put(message, encode(message))

    def resume(self, topics: Iterable[str], since: int) -> None:
        """Get what belongs to these topics since a message, and of telemetry how it stands."""
        self._topics = frozenset(topics)
        for topic, text in self._hub.since(since):
            if is_wanted(topic, self._topics):
                self._put(text)
        for message in self._hub.standing():
            if isinstance(message, Sample | Latest) and self.wants(topic_of(message)):
                self.put(message, encode(message))

    def wants(self, topic: str) -> bool:
        """Whether it subscribed to a topic."""
        return is_wanted(topic, self._topics)

    def put(self, message: Message, text: str) -> None:
        """Have a message sent; telemetry may be dropped later, what is told whole by the next."""
        if isinstance(message, Latest):
            self._latest[topic_of(message)] = text
            self._something.set()
            return
        if not isinstance(message, Sample):
            self._put(text)
            return
        if len(self._samples) == MOST_SAMPLES:
            self._dropped += 1
            self._hub.dropped += 1
        self._samples.append(text)
        self._something.set()

    async def batch(self) -> str:
        """Return what is to be sent next, as one JSON array; waits until there is something."""
        await self._something.wait()
        now_s = asyncio.get_running_loop().time
        await asyncio.sleep(max(GATHER_S, self._sent_s + BATCH_S - now_s()))
        self._sent_s = now_s()
        self._something.clear()
        texts = [*self._waiting, *self._samples, *self._latest.values()]
        if self._dropped:
            texts.append(encode(SamplesDropped(self._dropped)))
        self._waiting.clear()
        self._samples.clear()
        self._latest.clear()
        self._dropped = 0
        return f"[{','.join(texts)}]"

    def _put(self, text: str) -> None:
        if len(self._waiting) >= MOST_WAITING:
            self.too_slow = True
            self._waiting.clear()
        self._waiting.append(text)
        self._something.set()


class Hub:
    """Sends messages to all pages that want them.

    Args:
        system: the time, and what names this run.

    Attributes:
        instance: of this run; numbers of messages mean something within it only.
        dropped: telemetry values that were not sent to slow pages.
    """

    def __init__(self, system: System) -> None:
        self.instance = system.random_octets(8).hex()
        self.dropped = 0
        self._utc = system.utc_s
        self._seq = 0
        self._kept: deque[tuple[str, str]] = deque(maxlen=KEPT)
        self._standing: dict[tuple[object, ...], Message] = {}
        self._commands: dict[tuple[str, str, int], CommandStatus] = {}
        self._pages: list[PageConnection] = []
        self._others: tuple[OpenPage, ...] = ()

    def publish(self, message: Broadcast) -> None:
        """Send a message to the pages that want it, now or when they are back."""
        self._seq += 1
        topic, text = topic_of(message), encode(message, self._seq)
        self._kept.append((topic, text))
        self._keep(message)
        for page in self._pages:
            if page.wants(topic):
                page.put(message, text)

    def sample(self, sample: Sample) -> None:
        """Send a telemetry value to the pages that want it."""
        if sample.q is not Quality.LATE:
            self._standing[sample.ty, sample.asset, sample.key, sample.link] = sample
        self._send(sample)

    def tree(self, tree: TreeState) -> None:
        """Send how a tree is to the pages that want it."""
        self._standing[tree.ty, tree.asset] = tree
        self._send(tree)

    def transfer(self, transfer: Transfer) -> None:
        """Send how a transfer is to the pages that want it."""
        key = (transfer.ty, transfer.asset, transfer.id)
        if transfer.state is TransferState.REMOVED:
            self._standing.pop(key, None)
        else:
            self._standing[key] = transfer
        self._send(transfer)

    def _send(self, message: Sample | Latest) -> None:
        topic, text = topic_of(message), ""
        for page in self._pages:
            if page.wants(topic):
                text = text or encode(message)
                page.put(message, text)

    def open(self, console: str, operator: str) -> PageConnection:
        """Return what will wait for a page, which all are told of."""
        page = PageConnection(self, OpenPage(console, operator, self._utc()))
        self._pages.append(page)
        self._tell_presence()
        return page

    def close(self, page: PageConnection) -> None:
        """Forget a page."""
        self._pages.remove(page)
        self._tell_presence()

    def tell_others(self, pages: tuple[OpenPage, ...]) -> None:
        """Tell all pages of those that are open at other consoles, if that is news."""
        if pages != self._others:
            self._others = pages
            self._tell_presence()

    @property
    def pages(self) -> tuple[OpenPage, ...]:
        """The pages that are open here."""
        return tuple(page.present for page in self._pages)

    def is_present(self, operator: str) -> bool:
        """Whether an operator has a page open here."""
        return any(page.present.operator == operator for page in self._pages)

    def hello(self, page: PageConnection, *, resumed: bool) -> Hello:
        """Return the first message to a page."""
        operator = page.present.operator
        return Hello(PROTOCOL, self.instance, self._seq, self._utc(), operator, resumed)

    def can_resume(self, instance: object, seq: object) -> bool:
        """Whether all that was sent since a message can be sent again."""
        oldest = self._seq - len(self._kept)
        return instance == self.instance and isinstance(seq, int) and oldest <= seq <= self._seq

    def since(self, seq: int) -> Iterator[tuple[str, str]]:
        """Yield topic and text of each message after the one of a number."""
        return islice(self._kept, len(self._kept) - (self._seq - seq), None)

    def standing(self) -> tuple[Message, ...]:
        """Return the last message on each thing; commands in the order in which they began."""
        return (*self._standing.values(), *self._commands.values())

    def _tell_presence(self) -> None:
        self.publish(Presence((*self.pages, *self._others)))

    def _keep(self, message: Broadcast) -> None:
        match message:
            case CommandStatus(asset=asset, source=source, number=number):
                self._commands[asset, source, number] = message
                if len(self._commands) > KEPT_COMMANDS:
                    del self._commands[next(iter(self._commands))]
            case Notified() | FileChanged() | ObjectChanged():
                pass
            case Presence():
                self._standing[message.ty,] = message
            case AlarmStatus(id=number):
                self._standing[message.ty, number] = message
                if not message.standing:
                    del self._standing[message.ty, number]
            case LinkStatus(uri=uri):
                self._standing.pop((message.ty, uri), None)  # an asset may be at one after another
                self._standing[message.ty, uri] = message
            case AssetState(asset=asset, link=link) | AuthorityMessage(asset=asset, link=link):
                self._standing[message.ty, asset, link] = message
            case PlanProgress(asset=asset, plan=plan):
                self._standing[message.ty, asset, plan] = message
            case DictionaryChanged(asset=asset):
                self._standing[message.ty, asset] = message
            case _:
                assert_never(message)
