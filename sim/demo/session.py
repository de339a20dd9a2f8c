"""Mission control: plays a script over the socket, and keeps what comes back."""

import asyncio
import logging
from collections.abc import Coroutine, Sequence
from dataclasses import dataclass
from math import hypot, nan
from typing import Any, Final, Protocol, assert_never

from adapters.mal.errors import MalError
from adapters.mrs.client import MrsClient
from adapters.mrs.errors import in_words
from adapters.mrs.types import AssetMode, Notification
from executive.parameters import Parameter
from sim.demo.life import Life
from sim.demo.script import AtOnce, Step, WhenDone, WhenNear

LOOK_S: Final = 0.1
_LOG: Final = logging.getLogger(__name__)
LONGEST_S: Final = 180.0


@dataclass(frozen=True, slots=True)
class Situation:
    """What the rover says of itself; NaN what it does not know."""

    mode: AssetMode
    x_m: float
    y_m: float
    heading_rad: float
    travel_mps: float
    battery_v: float


class Audience(Protocol):
    """Who is shown the session while it is played."""

    def changed(self, life: Life) -> None:
        """See that a command was sent, or got further."""
        ...

    def looked(self, situation: Situation) -> None:
        """See how the rover is."""
        ...


class Session:
    """One play of a script.

    Attributes:
        lives: the commands sent, in their order.
        reports: every notification that came, of commands and of events.
    """

    def __init__(self, client: MrsClient, audience: Audience) -> None:
        """Prepare; nothing is sent yet."""
        self.lives: list[Life] = []
        self.reports: list[Notification] = []
        self._client = client
        self._heard = client.notifications()
        self._audience = audience
        self._situation: Situation | None = None
        self._news = asyncio.Condition()

    async def play(self, script: Sequence[Step]) -> None:
        """Play a script to its end, whatever becomes of its commands.

        Raises:
            ConnectionError: the rover cannot be reached any more.
            TimeoutError: a command did not end within `LONGEST_S`.
        """
        async with asyncio.timeout(LONGEST_S):
            await until_first(self._play(script), self._listen(), self._look())

    async def _play(self, script: Sequence[Step]) -> None:
        for step in script:
            await self._wait_for_cue(step)
            command = self.lives[-1].command if step.repeats else self._client.command(step.request)
            await self._send(Life(step, command))
        await self._until_all_ended()

    async def _wait_for_cue(self, step: Step) -> None:
        match step.cue:
            case AtOnce():
                return
            case WhenDone(look_s):
                await self._until_all_ended()
                await asyncio.sleep(look_s)
            case WhenNear(place, distance_m):
                async with self._news:
                    await self._news.wait_for(
                        lambda: (
                            self._situation is not None
                            and hypot(
                                self._situation.x_m - place.x_m, self._situation.y_m - place.y_m
                            )
                            <= distance_m
                        )
                    )
            case _:
                assert_never(step.cue)

    async def _send(self, life: Life) -> None:
        self.lives.append(life)
        self._audience.changed(life)
        _LOG.info("%s %s", life.command.identity, life.spelled)
        try:
            await self._client.submit(life.command)
        except MalError as answer:
            life.answer = answer
            _LOG.info("%s answered: %s", life.command.identity, in_words(answer))
            if not life.notifications:
                self._audience.changed(life)
            async with self._news:
                self._news.notify_all()

    async def _until_all_ended(self) -> None:
        async with self._news:
            await self._news.wait_for(lambda: all(life.ending for life in self.lives))

    async def _listen(self) -> None:
        async for notification in self._heard:
            if all(known.sequence != notification.sequence for known in self.reports):
                self.reports.append(notification)
            async with self._news:
                for life in self.lives:
                    if life.see(notification):
                        self._audience.changed(life)
                self._news.notify_all()

    async def _look(self) -> None:
        while True:
            self._situation = await look(self._client)
            self._audience.looked(self._situation)
            async with self._news:
                self._news.notify_all()
            await asyncio.sleep(LOOK_S)


async def look(client: MrsClient) -> Situation:
    """Ask the rover how it is."""
    status = await client.get_status()
    figures = {
        value.name: nan if value.value is None else float(value.value.value)
        for value in status.values
    }
    return Situation(
        status.mode,
        figures[Parameter.POS_X.value],
        figures[Parameter.POS_Y.value],
        figures[Parameter.HEAD.value],
        figures[Parameter.CURRENT_TRAVEL_SPEED.value],
        figures[Parameter.BATERY_VOLTAGE.value],
    )


async def until_first(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run all until the first ends, and raise what it raised; the others are cancelled."""
    tasks = [asyncio.ensure_future(coroutine) for coroutine in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
