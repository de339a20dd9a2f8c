"""The demonstration once its processes are starting: waits until they are ready, and plays."""

import asyncio
import logging
from collections.abc import Coroutine, Sequence
from contextlib import AsyncExitStack, ExitStack
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
from sim.processes import LOOK_S, AddressError, OperationsConsole, ProcessGroup
from sim.processes.recorder import RoverRecorder, recorder, since_start_s, told

BROWSE: Final = "In a browser on this computer: "
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
    heard: RoverRecorder


def await_executives(participants: Participants) -> None:
    """Wait until all executives know where their rovers are. Leaves no thread behind.

    Raises:
        ChildError: a process ended.
        TimeoutError: a rover did not get ready in time.
    """

    async def locate() -> None:
        for rover in participants.rovers:
            async with await MrsClient.connect(await rover.uri()) as client:
                await _located([client])

    asyncio.run(_in_time(locate(), participants.processes))


def play(
    participants: Participants,
    folder: Path,
    console: Console,
    operations: OperationsConsole | None,
    *,
    scripted: bool = True,
) -> Sequence[Played]:
    """Wait until the rovers can be commanded, say so, and play all sessions at once.

    Args:
        participants: with whom.
        folder: where mission control's own log goes.
        console: where it is shown.
        operations: whose address is told once it serves.
        scripted: whether anything is played.

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
    with ExitStack() as listening:
        heard = []
        for each in participants.members:
            asset, domain = each.script.asset, each.rover.place.domain
            parameters = config_folder() / f"{asset}.ros.yaml"
            heard.append(listening.enter_context(recorder(asset, domain, parameters)))
        return asyncio.run(_play(participants, heard, console, operations, scripted))


async def _play(
    participants: Participants,
    heard: Sequence[RoverRecorder],
    console: Console,
    operations: OperationsConsole | None,
    scripted: bool,
) -> Sequence[Played]:
    members, several = participants.members, len(participants.members) > 1
    async with AsyncExitStack() as connected:
        clients: list[dict[Link, MrsClient]] = [{} for _ in members]

        async def connect() -> None:
            for member, links in zip(members, clients, strict=True):
                for link in sorted(member.script.links, key=lambda link: link.value):
                    client = await MrsClient.connect(await participants.uri(member, link))
                    links[link] = await connected.enter_async_context(client)
            await _located([client for links in clients for client in links.values()])
            while not all(each.ready for each in heard):
                await asyncio.sleep(LOOK_S / 5)

        await _in_time(connect(), participants.processes)
        await _require_alone(members, heard)
        ready = "rovers and executives are" if several else "rover and executive are"
        console.print(f"{ready} ready after {told(since_start_s())}", style="dim")
        if not scripted:
            return ()
        with display(console) as shown:
            played = []
            for member, links, listener in zip(members, clients, heard, strict=True):
                script = member.script
                audience = shown.audience(script, script.asset if several else "")
                session = Session(links, audience, script.watched, member.rover.speed)
                played.append(Played(member, session, listener))

            async def tell_address() -> None:
                if operations is not None:
                    console.print(BROWSE + await operations.address())

            async def play_all() -> None:
                await asyncio.gather(
                    tell_address(),
                    *(each.session.play(each.participant.script.steps) for each in played),
                )
                await asyncio.sleep(SETTLE_S)

            await until_first(play_all(), participants.processes.guard())
    return played


async def _require_alone(members: Sequence[Participant], heard: Sequence[RoverRecorder]) -> None:
    """Look who else is in the ROS domains, where others may be."""
    if any(member.rover.place.shared for member in members):
        await asyncio.sleep(DISCOVERY_S)
    for member, listener in zip(members, heard, strict=True):
        if listener.rovers() > 1:
            raise AddressError(
                f"another rover drives in ROS domain {member.rover.place.domain}."
                " End that one, or set ROS_DOMAIN_ID to another number, the same in every terminal."
            )


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
