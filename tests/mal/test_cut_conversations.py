"""Conversations between a provider and some consumers, any of whom may be cut off at any moment.

Whatever happens, the consumer has seen what the handler did, in order, and then how it ended, once;
and neither side keeps anything of what is over.
"""

import asyncio
from dataclasses import dataclass, field
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from adapters.mal import (
    CallContext,
    Consumer,
    Interaction,
    MalError,
    Pattern,
    Provider,
    StandardError,
)
from tests.mal.wiretest import SERVICE, SPECIFICATION
from tests.support.examples import examples

PATIENCE_S = 60.0
LOST = ("error", StandardError.DESTINATION_LOST.value)
SHUTDOWN = ("error", StandardError.SHUTDOWN.value)
OPERATIONS = {
    Pattern.REQUEST: ("doRequest", float),
    Pattern.INVOKE: ("doInvoke", str),
    Pattern.PROGRESS: ("doProgress", int),
}
ENDS = ("response", "error")
Step = tuple[str, Any]


@dataclass(eq=False)
class Talk:
    """One interaction.

    Attributes:
        reported: what the handler was told to do, and whether the connection was lost.
        seen: what its consumer saw.
        steps: how the handler is told.
        over: whether nothing more can be seen.
        served: whether the handler still works; none does without its consumer.
    """

    pattern: Pattern
    consumer: Consumer
    reported: list[Step] = field(default_factory=list)
    seen: list[Step] = field(default_factory=list)
    steps: "asyncio.Queue[Step]" = field(default_factory=asyncio.Queue)
    over: bool = False
    served: bool = True

    def allows(self, step: Step) -> bool:
        acknowledged = self.pattern is Pattern.REQUEST or ("ack", None) in self.reported
        match step[0]:
            case "ack":
                return not acknowledged
            case "update":
                return acknowledged and self.pattern is Pattern.PROGRESS
            case "response":
                return acknowledged
            case _:
                return True


class Conversations(RuleBasedStateMachine):
    """Two sides over real sockets; each rule ends when both have noticed what it did."""

    consumers = Bundle("consumers")
    talks = Bundle("talks")
    steps = st.one_of(
        st.just(("ack", None)),
        st.tuples(st.just("update"), st.integers(0, 1000)),
        st.just(("response", None)),
        st.tuples(st.just("error"), st.integers(1, 9)),
    )

    def __init__(self) -> None:
        super().__init__()
        self.runner = asyncio.Runner()
        self.known: dict[str, Talk] = {}
        self.tasks: set[asyncio.Task[None]] = set()
        self.open: list[Consumer] = []
        self.provider = Provider(SPECIFICATION, SERVICE)
        self.provider.serve(SERVICE, "doSubmit", lambda *_: None)
        self.provider.serve(SERVICE, "doRequest", self._answer)
        self.provider.serve(SERVICE, "doInvoke", self._converse)
        self.provider.serve(SERVICE, "doProgress", self._converse)
        self.run(self.provider.start())

    def run(self, act: Any) -> Any:
        return self.runner.run(asyncio.wait_for(act, PATIENCE_S))

    @rule(target=consumers)
    def connect(self) -> Consumer:
        connecting = Consumer.connect(SPECIFICATION, self.provider.uri, timeout_s=PATIENCE_S)
        consumer: Consumer = self.run(connecting)
        self.open.append(consumer)
        return consumer

    @rule(target=talks, consumer=consumers, pattern=st.sampled_from(list(OPERATIONS)))
    def begin(self, consumer: Consumer, pattern: Pattern) -> Talk:
        talk = Talk(pattern, consumer)
        name, kind = OPERATIONS[pattern]
        number = len(self.known)
        self.known[str(number)] = talk

        async def begin() -> None:
            task = asyncio.create_task(_listen(talk, name, kind(number)))
            self.tasks.add(task)
            task.add_done_callback(self.tasks.discard)
            await asyncio.sleep(0)

        if consumer not in self.open:
            talk.reported.append(LOST)
            talk.over, talk.served = True, False
        self.run(begin())
        return talk

    @rule(talk=talks, step=steps)
    def act(self, talk: Talk, step: Step) -> None:
        """The handler does something."""
        if not talk.over and talk.allows(step):
            self._notify(talk, step)

    @rule(talk=talks, steps=st.lists(steps, max_size=3), by=st.sampled_from(["us", "them", "both"]))
    def act_and_be_cut(self, talk: Talk, steps: list[Step], by: str) -> None:
        """The handler does something, and nobody knows how far it comes."""
        if talk.consumer not in self.open:
            return
        for step in steps:
            if not talk.over and talk.allows(step):
                self._notify(talk, step)
        certain, hoped = talk.seen[:], talk.reported[:]
        self._cut(talk.consumer, by)
        assert hoped[: len(talk.seen)] == talk.seen or (
            talk.seen[-1] == LOST and hoped[: len(talk.seen) - 1] == talk.seen[:-1]
        )
        assert talk.seen[: len(certain)] == certain
        talk.reported = talk.seen[:]

    @rule(consumer=consumes(consumers))
    def hang_up(self, consumer: Consumer) -> None:
        """The consumer closes its connection, or finds that it is gone already."""
        if consumer in self.open:
            self._settle()
            self._cut(consumer, "politely")

    @invariant()
    def both_sides_agree(self) -> None:
        self._settle()
        for talk in self.known.values():
            assert talk.seen == talk.reported
        running = [talk for talk in self.known.values() if not talk.over]
        assert len(self.tasks) == len(running)
        assert len(self.provider._connections._open) == len(self.open)
        assert len(self.provider._running) == sum(talk.served for talk in self.known.values())
        for consumer in self.open:
            mine = sum(talk.consumer is consumer for talk in running)
            assert len(consumer._pending) == mine

    def teardown(self) -> None:
        try:
            self.run(self.provider.close())
            self.run(self._all_over())
            for talk in self.known.values():
                assert (
                    talk.seen == talk.reported
                    if talk.over
                    else talk.seen == [*talk.reported, SHUTDOWN]
                )
            for consumer in self.open:
                self.run(consumer.close())
        finally:
            self.runner.close()

    def _notify(self, talk: Talk, step: Step) -> None:
        talk.steps.put_nowait(step)
        talk.reported.append(step)
        talk.over = step[0] in ENDS
        talk.served = not talk.over

    def _cut(self, consumer: Consumer, by: str) -> None:
        port = consumer.local_address[1]
        ours = consumer._connection
        (theirs,) = [c for c in self.provider._connections._open if c.peer.endswith(f":{port}")]
        concerned = [talk for talk in self.known.values() if talk.consumer is consumer]

        async def cut() -> None:
            for end, source in ((ours, "us"), (theirs, "them")):
                if by in (source, "both"):
                    assert end._transport is not None
                    end._transport.abort()
            if by == "politely":
                await consumer.close()
            await asyncio.wait([ours.lost, theirs.lost])
            while any(not talk.seen or talk.seen[-1][0] not in ENDS for talk in concerned):
                await asyncio.sleep(0)

        self.run(cut())
        self.open.remove(consumer)
        for talk in concerned:
            talk.served = False
            if not talk.over:
                talk.reported.append(LOST)
                talk.over = True

    def _settle(self) -> None:
        """A round trip over every connection: what was sent before has come."""

        async def settle() -> None:
            for _ in range(2):
                await asyncio.sleep(0)
                for consumer in self.open:
                    await consumer.submit(SERVICE, "doSubmit", "", True)
            await asyncio.sleep(0)

        self.run(settle())

    async def _all_over(self) -> None:
        await asyncio.gather(*self.tasks)

    async def _answer(self, _call: CallContext, number: float) -> tuple[str]:
        step, value = await self.known[str(int(number))].steps.get()
        if step == "error":
            raise MalError(value)
        return ("done",)

    async def _converse(self, interaction: Interaction, number: str | int) -> tuple[Any]:
        talk = self.known[str(number)]
        while True:
            match await talk.steps.get():
                case ("ack", _):
                    interaction.acknowledge(42 if talk.pattern is Pattern.INVOKE else True)
                case ("update", value):
                    await interaction.update(value)
                case ("response", _):
                    return (1.0 if talk.pattern is Pattern.INVOKE else "done",)
                case (_, number):
                    raise MalError(number)


async def _listen(talk: Talk, name: str, number: Any) -> None:
    """Be the consumer of one interaction, and note what is seen."""
    consumer, seen = talk.consumer, talk.seen
    try:
        match talk.pattern:
            case Pattern.REQUEST:
                await consumer.request(SERVICE, name, number)
            case Pattern.INVOKE:
                invocation = await consumer.invoke(SERVICE, name, number, timeout_s=PATIENCE_S)
                seen.append(("ack", None))
                await invocation.response()
            case _:
                async with consumer.progress(SERVICE, name, number) as progress:
                    seen.append(("ack", None))
                    async for (value,) in progress:
                        seen.append(("update", value))
        seen.append(("response", None))
    except MalError as error:
        seen.append(("error", error.number))


TestConversations = Conversations.TestCase
TestConversations.settings = settings(max_examples=examples(60), stateful_step_count=30)
