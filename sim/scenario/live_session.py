"""Mission control of a live run: sends what is due over the socket, and keeps what comes back."""

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress
from math import inf

from adapters.mal.errors import MalError
from adapters.mrs.client import MrsClient
from executive.commands import Command
from sim.scenario import from_wire
from sim.scenario.expectations import Answer
from sim.scenario.how import How
from sim.scenario.live_files import fetched
from sim.scenario.live_listening import Listening
from sim.scenario.model import Ask, Cargo, Eclipse, Entry, Fetch, Repeat, Scenario, Send
from sim.scenario.record import Asked, NotFetched, Record, Sending
from sim.scenario.timeline import Ground, Timeline


class LiveSession:
    """One play.

    In an eclipse of the direct link it hangs up, and afterwards connects anew; by the relay it
    stays connected with the orbiter, which has no contact then.

    Args:
        uri: where the MRS of the rover is served.
        how: by which link that is.
        load: gives the rover a cargo, in kg.
        record: filled with all but the true poses.
        brief: whether the play ends as soon as all is played, and all that was admitted has ended.
    """

    def __init__(
        self,
        scenario: Scenario,
        uri: str,
        how: How,
        load: Callable[[float], None],
        record: Record,
        brief: bool = False,
    ) -> None:
        """Prepare; nothing is connected yet."""
        self._uri, self._how, self._load, self._brief = uri, how, load, brief
        self._entries = len(scenario.timeline)
        self._record = record
        self._lasts_s = scenario.lasts_s
        self._timeline = Timeline(scenario, record)
        self._ground = Ground(scenario, how.link)
        self._client: MrsClient | None = None
        self._listening: Listening | None = None
        self._contact_s = inf
        self._news = asyncio.Event()

    async def play(self) -> None:
        """Play to the end.

        Raises:
            ConnectionError: the rover could not be reached any more.
        """
        await self._connect()
        try:
            await self._send()
            if self._listening is not None:
                self._listening.check()
        finally:
            await self._hang_up()
        self._record.simulated_s = self._record.wall_s = self._now_s()

    def _now_s(self) -> float:
        return time.time() - self._record.start_utc_s

    async def _connect(self) -> None:
        self._client = await MrsClient.connect(self._uri)
        self._listening = Listening(self._client, self._record, self._how, self._news.set)
        await self._listening.begin()

    async def _hang_up(self) -> None:
        if self._listening is not None and self._client is not None:
            await self._listening.end()
            await self._client.close()
        self._listening = self._client = None

    async def _send(self) -> None:
        while (now_s := self._now_s()) < self._lasts_s and not (self._brief and self._done):
            if now_s >= self._contact_s:
                self._contact_s = inf
                await self._connect_again()
            for entry in self._timeline.due(now_s):
                await self._carry_out(entry)
                self._record.played += 1
            self._news.clear()
            until_s = min(self._timeline.next_s(), self._contact_s, self._lasts_s)
            with suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), max(0.0, until_s - self._now_s()))

    @property
    def _done(self) -> bool:
        record = self._record
        if record.played < self._entries:
            return False
        admitted = {sent.label for sent in record.sendings if sent.answer is Answer.ADMITTED}
        ends = [life[-1].stage for label in admitted if (life := record.life(label))]
        return len(ends) == len(admitted) and all(stage and stage.terminal for stage in ends)

    async def _connect_again(self) -> None:
        await self._connect()
        if self._listening is not None:
            await self._listening.catch_up()

    async def _carry_out(self, entry: Entry) -> None:
        match entry:
            case Send() | Repeat():
                label = entry.name if isinstance(entry, Send) else entry.repeat
                command = self._ground.command(entry, time.time())
                sent_s = self._now_s()
                answer = await self._submit(command)
                self._record.sendings.append(Sending(label, command.identity, sent_s, answer))
            case Ask(ask=label):
                self._record.answers.append(await self._asked(label))
            case Fetch(fetch=path):
                if self._client is None:
                    self._record.fetched.append(NotFetched(path, "nobody is there"))
                    return
                self._record.fetched.append(await fetched(self._client, path, self._record.files))
            case Cargo(cargo_kg=mass_kg):
                self._load(mass_kg)
            case Eclipse(eclipse_s=dark_s):
                if self._how is How.DIRECT:
                    await self._hang_up()
                    self._contact_s = self._now_s() + dark_s
            case _:
                raise TypeError(f"{type(entry).__name__} cannot be done over the socket")

    async def _submit(self, command: Command) -> Answer:
        if self._client is None:
            return Answer.LOST
        try:
            await self._client.submit(command)
        except MalError as error:
            return from_wire.answer(error)
        return Answer.ADMITTED

    async def _asked(self, label: str) -> Asked:
        if self._client is None:
            return Asked(label, (), ())
        values = from_wire.parameter_values(await self._client.get_value())
        direct = self._how is How.DIRECT
        files = await self._client.list_files() if direct else ()
        return Asked(label, self._record.heard(values), tuple(file.path for file in files))
