"""`play`, the session of the demonstration: waits for its processes, then runs the scenarios."""

import asyncio
import logging
import re
from collections import Counter
from collections.abc import Awaitable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Final, TypeVar

from rich.console import Console

from sim.demo.display import SessionView, display
from sim.demo.outcome import LOG, Played
from sim.processes import POLL_S, AddressError, OperationsConsole
from sim.processes.recorder import format_elapsed, since_start_s
from sim.scenario.live import ready, run_in_setup
from sim.scenario.model import RunMode, Scenario
from sim.scenario.scene import Fleet, LiveScene, links_of, scene_in

T = TypeVar("T")
SETTLE_S: Final = 0.3
REPORT_S: Final = 1.0
SPEED: Final = re.compile(r"(?:INFO|WARNING) +(.*simulated time runs at .*)")
"""Lines of the simulation's log on its speed."""
DISCOVERY_S: Final = 3.0
"""Time to discover the other nodes of a ROS domain; chosen, not measured."""


def play(
    fleet: Fleet,
    scenarios: Sequence[Scenario],
    folders: Sequence[Path],
    mode: RunMode,
    console: Console,
    operations: OperationsConsole | None,
    scripted: bool,
) -> Sequence[Played]:
    """Wait until the rovers accept commands, print that, and run all scenarios at once.

    Args:
        fleet: rovers that are starting.
        scenarios: one per rover.
        mode: link of the commands that name none.
        console: output of the display.
        folders: output folder of each rover. With several, mission control's log is in the parent.
        operations: console whose address is printed once it serves.
        scripted: whether the scenarios are run.

    Raises:
        ChildError: a process ended.
        ConnectionError: the connection to a rover was lost.
        AddressError: another rover is in the same ROS domain.
        TimeoutError: the rovers did not get ready in time.
    """
    folder = folders[0] if len(folders) == 1 else folders[0].parent
    logging.basicConfig(
        filename=folder / LOG,
        level="INFO",
        format="%(asctime)s %(levelname)-7s %(message)s",
        force=True,
    )
    with ExitStack() as listening:
        scenes = [
            listening.enter_context(scene_in(fleet, rover, scenario))
            for rover, scenario in zip(fleet.rovers, scenarios, strict=True)
        ]

        async def play_all() -> Sequence[Played]:
            await print_address(operations, console)
            for scene, scenario in zip(scenes, scenarios, strict=True):
                await _guarded(fleet, _get_ready(scene, scenario, mode))
            names = "rovers and executives are" if len(scenes) > 1 else "rover and executive are"
            console.print(f"{names} ready after {format_elapsed(since_start_s())}", style="dim")
            if not scripted:
                return ()
            with display(console) as shown:

                async def play_one(scene: LiveScene, scenario: Scenario, folder: Path) -> Played:
                    links = [each.link for each in links_of(scenario, mode)]
                    name = scenario.settings.asset if len(scenes) > 1 else ""
                    view: SessionView = shown.view(links, name)
                    record = await run_in_setup(
                        scene, scenario, mode, brief=True, on_update=view.on_update
                    )
                    return Played(scene, scenario, folder, record)

                plays = asyncio.gather(*map(play_one, scenes, scenarios, folders))
                slowdown = SlowdownReport(fleet, console)
                reporting = asyncio.create_task(slowdown.run())
                try:
                    played = await _guarded(fleet, plays)
                finally:
                    reporting.cancel()
                await asyncio.sleep(SETTLE_S)
                return played

        return asyncio.run(play_all())


async def print_address(operations: OperationsConsole | None, console: Console) -> None:
    """Wait until the console serves, and print its address."""
    if operations is not None:
        address = await operations.address()
        console.print(f"open {address} now, in a browser on this computer", style="bold")


class SlowdownReport:
    """Prints the lines of the simulations on their speed, each line once."""

    def __init__(self, fleet: Fleet, console: Console) -> None:
        self._fleet, self._console = fleet, console
        self._printed = Counter[str]()

    def update(self) -> None:
        """Print new lines."""
        for child in self._fleet.processes.children:
            found = child.find_outputs(SPEED)
            for line in found[self._printed[child.name] :]:
                self._console.print(line, style="yellow")
            self._printed[child.name] = len(found)

    async def run(self) -> None:
        """Print new lines until cancelled."""
        while True:
            self.update()
            await asyncio.sleep(REPORT_S)


async def _get_ready(scene: LiveScene, scenario: Scenario, mode: RunMode) -> None:
    """Wait until a rover is ready on all links, and is the only publisher of its topics."""
    for link in links_of(scenario, mode):
        await ready(scene, link)
    while not scene.recorder.ready:
        await asyncio.sleep(POLL_S / 5)
    address = scene.rover.address
    if address.shared:
        await asyncio.sleep(DISCOVERY_S)
    if scene.recorder.rovers() > 1:
        raise AddressError(
            f"another rover runs in ROS domain {address.domain}."
            " End it, or set ROS_DOMAIN_ID to another number, the same in every terminal."
        )


async def _guarded(fleet: Fleet, work: Awaitable[T]) -> T:
    """Return the result of `work`. Raise ChildError if a process ends before."""
    working = asyncio.ensure_future(work)
    guard = asyncio.ensure_future(fleet.processes.guard())
    try:
        await asyncio.wait((working, guard), return_when=asyncio.FIRST_COMPLETED)
        if guard.done():
            guard.result()
        return working.result()
    finally:
        for task in (working, guard):
            task.cancel()
        await asyncio.gather(working, guard, return_exceptions=True)
