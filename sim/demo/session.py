"""Mission control: plays a script over the sockets of its links, and keeps what comes back."""

import asyncio
import logging
import time
from collections.abc import Coroutine, Mapping, Sequence
from dataclasses import dataclass
from math import hypot, inf, nan
from typing import Any, Final, Protocol, assert_never

from adapters.mal import MalError
from adapters.mrs.ground import (
    DTN_OLDEST,
    DTN_QUEUED,
    LAST_HEARD,
    NEXT_CONTACT,
    MrsClient,
)
from adapters.mrs.spec import AreaError, AssetMode, Notification, Stage, describe_error, given_up
from executive.commands import Command
from executive.values.parameters import Parameter
from executive.values.reports import TERMINAL
from sim.demo.script import AtOnce, Ending, Link, Step, WhenDark, WhenDone, WhenNear, spelled


@dataclass(frozen=True, slots=True)
class Told:
    """A notification, and when the ground had it."""

    notification: Notification
    utc_s: float

    @property
    def aboard_utc_s(self) -> float:
        """When it was made, by the clock aboard."""
        return self.notification.timestamp / 1e9


class Life:
    """What became of a command so far.

    Attributes:
        step: what the script says of it.
        sent_utc_s: when this was made, just before it is sent.
        told: the notifications of its life that came by its link, each once, in their order aboard.
        taken_utc_s: when it was answered that it is taken: by the rover, or stored at the orbiter.
        answer: the error that answered it, if it was not taken.
        lost: what the relay said when it gave it up.
    """

    def __init__(self, step: Step, command: Command, first: Link | None = None) -> None:
        self.step = step
        self.command = command
        self.sent_utc_s = time.time()
        self.told: list[Told] = []
        self.taken_utc_s: float | None = None
        self.answer: MalError | None = None
        self.lost: Told | None = None
        self._again = first is step.link

    @property
    def spelled(self) -> str:
        """The command for people."""
        return spelled(self.command.request)

    @property
    def ending(self) -> Ending | None:
        """How it ended, if it has."""
        if self.answer is not None and self.answer.number == AreaError.DUPLICATE.value:
            return Ending.DUPLICATE
        if self.stage in TERMINAL:
            return Ending[self.stage.name]
        if self.lost is not None:
            return Ending.EXPIRED
        return None if self.answer is None else Ending.REJECTED

    @property
    def stage(self) -> Stage | None:
        """The last stage that it reached."""
        return self.told[-1].notification.stage if self.told else None

    @property
    def stored(self) -> bool:
        """Whether it is, or was, in the hands of the orbiter."""
        return self.step.link is Link.RELAY and self.taken_utc_s is not None

    @property
    def as_expected(self) -> bool:
        """Whether it ended as the script says."""
        return self.ending is self.step.expected

    @property
    def text(self) -> str:
        """What was last said of it: why it ended, or how far it is."""
        if self.ending is Ending.DUPLICATE and self.answer is not None:
            known = describe_error(self.answer).partition(": ")[2]
            return f"told again: {self._last}" if self.told else known
        if self.lost is not None:
            return (self.lost.notification.text or "").partition(": ")[2]
        if not self.told:
            return "" if self.answer is None else describe_error(self.answer)
        return self._last

    @property
    def _last(self) -> str:
        last = self.told[-1].notification
        if last.text in (None, self.command.name):
            return ""
        return f"{last.text} (reason {last.code})" if last.code else last.text or ""

    def reached(self, stage: Stage) -> Told | None:
        """Return what was told of a stage, if it was."""
        return next((told for told in self.told if told.notification.stage is stage), None)

    @property
    def ended(self) -> Told | None:
        """What was told of its end."""
        return self.told[-1] if self.stage in TERMINAL else self.lost

    def see(self, told: Told) -> bool:
        """Take a notification of this link if it is of this life; return whether it is.

        To a repeat the rover sends the last notification of the first once more: it is not taken
        twice by the same link.
        """
        identity, new = self.command.identity, told.notification
        if given_up(new) == identity:
            self.lost = told
            return True
        if (
            new.stage is None
            or self._again
            or (new.source, new.commandId) != (identity.source, identity.command_id)
        ):
            return False
        if any(known.notification.sequence == new.sequence for known in self.told):
            return False
        self.told.append(told)
        self.told.sort(key=lambda known: known.notification.sequence)
        return True


@dataclass(frozen=True, slots=True)
class RelayStatus:
    """How the relay is doing; infinity for what it does not know.

    Attributes:
        queued: how many bundles wait at the orbiter.
        oldest_s: how long the oldest command has waited there.
        next_contact_s: until contact begins, 0 during one.
        last_heard_s: since something was heard of the rover.
    """

    queued: float
    oldest_s: float
    next_contact_s: float
    last_heard_s: float

    @property
    def dark(self) -> bool:
        """Whether there is no contact."""
        return self.next_contact_s > 0


@dataclass(frozen=True, slots=True)
class RoverStatus:
    """What the rover says of itself; NaN what it does not know.

    Attributes:
        relay: how the relay is doing; None by the direct link.
    """

    mode: AssetMode
    x_m: float
    y_m: float
    heading_rad: float
    travel_mps: float
    battery_v: float
    relay: RelayStatus | None = None


async def look(client: MrsClient) -> RoverStatus:
    """Ask the rover, or the relay in its place, how it is."""
    status = await client.get_status()
    figures = {
        value.name: float(value.value.value)
        for value in status.values
        if value.value is not None and not isinstance(value.value.value, str)
    }
    relayed = any(value.name == DTN_QUEUED for value in status.values)
    return RoverStatus(
        status.mode,
        figures.get(Parameter.POS_X.value, nan),
        figures.get(Parameter.POS_Y.value, nan),
        figures.get(Parameter.HEAD.value, nan),
        figures.get(Parameter.CURRENT_TRAVEL_SPEED.value, nan),
        figures.get(Parameter.BATERY_VOLTAGE.value, nan),
        _relay_status(figures) if relayed else None,
    )


def _relay_status(figures: Mapping[str, float]) -> RelayStatus:
    return RelayStatus(
        figures.get(DTN_QUEUED, inf),
        figures.get(DTN_OLDEST, inf),
        figures.get(NEXT_CONTACT, inf),
        figures.get(LAST_HEARD, inf),
    )


LOOK_S: Final = 0.1
_LOG: Final = logging.getLogger(__name__)
LONGEST_S: Final = 180.0


class Audience(Protocol):
    """Who is shown the session while it is played."""

    def changed(self, life: Life) -> None:
        """See that a command was sent, or got further."""
        ...

    def looked(self, status: RoverStatus) -> None:
        """See how the rover is."""
        ...


class Session:
    """One play of a script.

    Args:
        clients: mission control's end of each link.
        audience: who is shown it.
        watched: the link by which mission control sees how the rover is.
        speed: simulated seconds per second.

    Attributes:
        lives: the commands sent, in their order.
        reports: every notification that came by a link, of commands and of events.
        relay_history: how the relay was doing, at which UTC.
    """

    def __init__(
        self,
        clients: Mapping[Link, MrsClient],
        audience: Audience,
        watched: Link = Link.DIRECT,
        speed: float = 1.0,
    ) -> None:
        self.lives: list[Life] = []
        self.reports: dict[Link, list[Told]] = {link: [] for link in clients}
        self.relay_history: list[tuple[float, RelayStatus]] = []
        self._clients = clients
        self._heard = {link: client.notifications() for link, client in clients.items()}
        self._audience, self._watched, self._speed = audience, watched, speed
        self._seen: dict[Link, RoverStatus] = {}
        self._news = asyncio.Condition()

    async def play(self, script: Sequence[Step]) -> None:
        """Play a script to its end, whatever becomes of its commands.

        Raises:
            ConnectionError: the rover cannot be reached any more.
            TimeoutError: a command did not end within `LONGEST_S`.
        """
        links = self._clients
        try:
            async with asyncio.timeout(LONGEST_S):
                await until_first(
                    self._play(script), *map(self._listen, links), *map(self._look, links)
                )
        except TimeoutError as error:
            late = ", ".join(life.spelled for life in self.lives if not life.ending)
            raise TimeoutError(f"{late} did not end within {LONGEST_S:.0f} s") from error

    async def _play(self, script: Sequence[Step]) -> None:
        for step in script:
            await self._wait_for_cue(step)
            await self._send(self._life(step))
        await self._until_all_ended()

    def _life(self, step: Step) -> Life:
        if step.repeats:
            last = self.lives[-1]
            return Life(step, last.command, last.step.link)
        client = self._clients[step.link]
        return Life(step, client.command(step.request, lifetime_s=step.lifetime_s))

    async def _wait_for_cue(self, step: Step) -> None:
        match step.cue:
            case AtOnce(pause_s):
                await asyncio.sleep(pause_s / self._speed)
            case WhenDone(look_s):
                await self._until_all_ended()
                await asyncio.sleep(look_s / self._speed)
            case WhenNear(place, distance_m):
                async with self._news:
                    await self._news.wait_for(
                        lambda: self._is_near(place.x_m, place.y_m, distance_m) or self._all_ended
                    )
            case WhenDark(pause_s):
                async with self._news:
                    await self._news.wait_for(
                        lambda: any(status.dark for _, status in self.relay_history)
                    )
                await asyncio.sleep(pause_s / self._speed)
            case _:
                assert_never(step.cue)

    def _is_near(self, x_m: float, y_m: float, distance_m: float) -> bool:
        seen = self._seen.get(self._watched)
        return seen is not None and hypot(seen.x_m - x_m, seen.y_m - y_m) <= distance_m

    async def _send(self, life: Life) -> None:
        self.lives.append(life)
        self._audience.changed(life)
        _LOG.info("%s %s by %s", life.command.identity, life.spelled, life.step.link.value)
        try:
            await self._clients[life.step.link].submit(life.command)
            life.taken_utc_s = time.time()
        except MalError as answer:
            life.answer = answer
            _LOG.info("%s answered: %s", life.command.identity, describe_error(answer))
        if not life.told:
            self._audience.changed(life)
        await self._notify()

    async def _notify(self) -> None:
        async with self._news:
            self._news.notify_all()

    async def _until_all_ended(self) -> None:
        async with self._news:
            await self._news.wait_for(lambda: self._all_ended)

    @property
    def _all_ended(self) -> bool:
        return all(life.ending for life in self.lives)

    async def _listen(self, link: Link) -> None:
        kept = self.reports[link]
        async for notification in self._heard[link]:
            told = Told(notification, time.time())
            number = notification.sequence
            if not (number and any(known.notification.sequence == number for known in kept)):
                kept.append(told)
            for life in self.lives:
                if life.step.link is link and life.see(told):
                    self._audience.changed(life)
            await self._notify()

    async def _look(self, link: Link) -> None:
        while True:
            seen = self._seen[link] = await look(self._clients[link])
            if seen.relay is not None:
                self.relay_history.append((time.time(), seen.relay))
            if link is self._watched:
                self._audience.looked(seen)
            await self._notify()
            await asyncio.sleep(LOOK_S / self._speed)


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
