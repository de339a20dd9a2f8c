"""The demonstration once its processes are starting: waits until they are ready, and plays."""

import asyncio
import logging
from collections.abc import Coroutine, Iterator, Mapping, Sequence
from contextlib import AsyncExitStack, ExitStack, contextmanager
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any, Final

from rich.console import Console

from adapters.mrs.ground import MrsClient
from executive.settings import config_folder
from sim.demo.display import display
from sim.demo.participants import Participant, Participants
from sim.demo.script import Link
from sim.demo.session import Session, look, until_first
from sim.processes import LOOK_S, PlaceError, ProcessGroup
from sim.processes.recorder import Recorder, recorder, since_start_s, told

LOG: Final = "mission-control.log"
START_S: Final = 60.0
SETTLE_S: Final = 0.3
DISCOVERY_S: Final = 3.0
"""What it may take to see who else is in a ROS domain."""


@dataclass(frozen=True, slots=True)
class Played:
    """A session that was played, and what was heard beside it."""

    participant: Participant
    session: Session
    heard: Recorder


Clients = Mapping[Link, MrsClient]


def await_executives(participants: Participants) -> None:
    """Wait until all executives know where their rovers are. Leaves no thread behind.

    Raises:
        ChildError: a process ended.
        TimeoutError: a rover did not get ready in time.
    """

    async def locate() -> None:
        async with AsyncExitStack() as connected:
            for rover in participants.rovers:
                client = await MrsClient.connect(await rover.uri())
                await _located([await connected.enter_async_context(client)])

    async def in_time() -> None:
        await _in_time(locate(), participants.processes)

    asyncio.run(in_time())


def await_rovers(participants: Participants, console: Console) -> None:
    """Wait until the rovers can be commanded, and say so.

    Raises:
        ChildError: a process ended.
        PlaceError: another rover is in the same ROS domain.
        TimeoutError: they did not get ready in time.
    """

    async def ready(heard: Sequence[Recorder]) -> None:
        async with AsyncExitStack() as connected:
            await _connect(participants, heard, console, connected)

    with _recorders(participants) as heard:
        asyncio.run(ready(heard))


def play(participants: Participants, folder: Path, console: Console) -> Sequence[Played]:
    """Play all sessions at once; mission control's own log goes to the folder.

    Raises:
        ChildError: a process ended.
        ConnectionError: a rover could not be reached any more.
        PlaceError: another rover is in the same ROS domain.
        TimeoutError: the rovers did not get ready in time, or a command did not end.
    """
    logging.basicConfig(
        filename=folder / LOG,
        level="INFO",
        format="%(asctime)s %(levelname)-7s %(message)s",
        force=True,
    )
    with _recorders(participants) as heard:
        sessions = asyncio.run(_play(participants, heard, console))
        return tuple(map(Played, participants.members, sessions, heard))


@contextmanager
def _recorders(participants: Participants) -> Iterator[Sequence[Recorder]]:
    with ExitStack() as listening:
        yield [
            listening.enter_context(
                recorder(
                    participant.script.asset,
                    participant.rover.place.domain,
                    config_folder() / f"{participant.script.asset}.ros.yaml",
                )
            )
            for participant in participants.members
        ]


async def _play(
    participants: Participants, heard: Sequence[Recorder], console: Console
) -> Sequence[Session]:
    async with AsyncExitStack() as connected:
        clients = await _connect(participants, heard, console, connected)
        with display(console) as shown:
            sessions = []
            for participant, links in zip(participants.members, clients, strict=True):
                heading = participant.script.asset if len(participants.members) > 1 else ""
                audience = shown.audience(participant.script, heading)
                sessions.append(
                    Session(links, audience, participant.script.watched, participant.rover.speed)
                )

            async def play_all() -> None:
                async with asyncio.TaskGroup() as playing:
                    for participant, session in zip(participants.members, sessions, strict=True):
                        playing.create_task(session.play(participant.script.steps))
                await asyncio.sleep(SETTLE_S)

            await until_first(play_all(), participants.processes.guard())
    return sessions


async def _connect(
    participants: Participants,
    heard: Sequence[Recorder],
    console: Console,
    connected: AsyncExitStack,
) -> Sequence[Clients]:
    """Wait until the rovers can be commanded, and return mission control's ends of all links."""
    clients: list[Clients] = []

    async def connect() -> None:
        for participant in participants.members:
            links = {}
            for link in sorted(participant.script.links, key=lambda link: link.value):
                client = await MrsClient.connect(await _uri(participant, link, participants))
                links[link] = await connected.enter_async_context(client)
            clients.append(links)
        await _located([client for links in clients for client in links.values()])
        while not all(listener.ready for listener in heard):
            await asyncio.sleep(LOOK_S / 5)

    await _in_time(connect(), participants.processes)
    if any(participant.rover.place.shared for participant in participants.members):
        await asyncio.sleep(DISCOVERY_S)
    for participant, listener in zip(participants.members, heard, strict=True):
        if listener.rovers() > 1:
            raise PlaceError(
                f"another rover drives in ROS domain {participant.rover.place.domain}."
                " End that one, or set ROS_DOMAIN_ID to another number, the same in every terminal."
            )
    ready = (
        "rover and executive are" if len(participants.members) == 1 else "rovers and executives are"
    )
    console.print(f"{ready} ready after {told(since_start_s())}", style="dim")
    return clients


async def _uri(participant: Participant, link: Link, participants: Participants) -> str:
    if link is Link.RELAY and participants.orbiter is not None:
        return await participants.orbiter.uri(participant.script.asset)
    return await participant.rover.uri()


async def _located(clients: Sequence[MrsClient]) -> None:
    """Return when it is known by all links where the rovers are."""
    for client in clients:
        while isnan((await look(client)).x_m):
            await asyncio.sleep(LOOK_S / 5)


async def _in_time(getting_ready: Coroutine[Any, Any, None], processes: ProcessGroup) -> None:
    try:
        async with asyncio.timeout(START_S):
            await until_first(getting_ready, processes.guard())
    except TimeoutError as error:
        logs = " and ".join(map(str, processes.logs))
        raise TimeoutError(f"it was not ready after {START_S:.0f} s; see {logs}") from error
