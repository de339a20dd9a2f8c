"""`play`, the session of the demonstration, runs the scenarios; `show_outcome` prints results."""

import asyncio
import logging
import re
import shutil
from collections import Counter
from collections.abc import Awaitable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from rich.console import Console
from rich.table import Table

from executive.values.reasons import Reason
from executive.values.reports import Stage
from sim.demo.display import SessionView, display
from sim.processes import POLL_S, AddressError, OperationsConsole
from sim.processes.recorder import format_elapsed, since_start_s
from sim.scenario.live import ready, run_in_setup
from sim.scenario.model import RunMode, Scenario
from sim.scenario.outcome import judge
from sim.scenario.pictures import last_error, queue_figures, write_run
from sim.scenario.record import Record
from sim.scenario.scene import Fleet, LiveScene, links_of, scene_in
from sim.scenario.sent import RELAY, sent_commands
from sim.scenario.truth import path_length_m
from trees import as_svg as tree_as_svg

T = TypeVar("T")
SETTLE_S: Final = 0.3
REPORT_S: Final = 1.0
SPEED: Final = re.compile(r"(?:INFO|WARNING) +(.*simulated time runs at .*)")
"""Lines of the simulation's log on its speed."""
DISCOVERY_S: Final = 3.0
"""Time to discover the other nodes of a ROS domain; chosen, not measured."""


LOG = "mission-control.log"
LATE = (Reason.ODOMETRY_STALE, Reason.ODOMETRY_JUMPED)
MIN_LATE_TICKS = 20
"""Late ticks of a session that may be the cause of its failures: those of a second."""
OVERRUNS = "EXEC_OVERRUNS"
TOO_SLOW = (
    "The probable cause: this computer is too slow or busy, {} ticks of the executive were late."
    " Close other programs, or use --speed 0.5."
)

Files = Iterator[tuple[tuple[Path, ...], str]]


@dataclass(frozen=True, slots=True)
class Played:
    """A session that was run, and the folder of its files."""

    scene: LiveScene
    scenario: Scenario
    folder: Path
    record: Record


def show_outcome(played: Sequence[Played], folder: Path, console: Console) -> bool:
    """Write the files, print the figures, and return whether all expectations are met."""
    files = Table(box=None, show_header=False, pad_edge=False)
    for each in played:
        console.print("")
        if len(played) > 1:
            console.print(each.scenario.settings.asset, style="bold")
        console.print(_summary(each))
        for paths, meaning in _write(each):
            _add(files, folder, paths, meaning)
    for paths, meaning in _write_all(played, folder):
        _add(files, folder, paths, meaning)
    console.print("")
    console.print(f"Files in {folder}", style="bold")
    console.print(files)
    failed = [
        finding
        for each in played
        for finding in judge(each.scenario, each.record)
        if not finding.passed
    ]
    for finding in failed:
        text = f"{finding.subject}: expected {finding.expected}; observed: {finding.observed}"
        console.print(text, style="red", markup=False)
    late = max(late_ticks(each.record) for each in played)
    if failed and (late >= MIN_LATE_TICKS or any(odometry_late(each.record) for each in played)):
        console.print(TOO_SLOW.format(late), style="red")
    return not failed


def odometry_late(record: Record) -> bool:
    """Return whether the rover was stopped because its odometry was stale."""
    return any(report.reason in LATE for report in record.reports)


def late_ticks(record: Record) -> int:
    """Return the number of late ticks of the executive during the session."""
    counts = [each.values[OVERRUNS] for each in record.statuses if OVERRUNS in each.values]
    return round(counts[-1] - counts[0]) if counts else 0


def _add(files: Table, folder: Path, paths: Sequence[Path], meaning: str) -> None:
    files.add_row(", ".join(str(path.relative_to(folder)) for path in paths), meaning)


def _summary(played: Played) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column(style="bold")
    table.add_column()
    record, received = played.record, played.scene.recorder
    if record.poses and record.odometry:
        drift_m = record.poses[-1].pose.point.distance_m(record.odometry[-1].point)
        table.add_row(
            "true error at the last waypoint",
            f"{last_error(record)}   (odometry is {100 * drift_m:.1f} cm off)",
        )
    table.add_row("driven", f"{path_length_m(record.poses):.1f} m in {record.simulated_s:.1f} s")
    if received.moved_after_s is not None:
        table.add_row("first motion", f"{format_elapsed(received.moved_after_s)} after the start")
    if any(receipt.link == RELAY for receipt in record.receipts):
        for name, figure in queue_figures(record):
            table.add_row(name, figure)
    for row in by_both(record):
        table.add_row(*row)
    return table


def by_both(record: Record) -> Iterator[tuple[str, str]]:
    """Yield for each command sent over both links how often the rover started it."""
    for sent in sent_commands(record):
        if sent.again and not sent.known:
            started = {
                (each.link, each.report.sequence)
                for each in record.receipts
                if each.report.identity == sent.sending.identity
                and each.report.stage is Stage.STARTED
            }
            count = max(Counter(link for link, _ in started).values(), default=0)
            times = "once" if count == 1 else f"{count} times"
            yield "sent over both links", f"{sent.title}, executed {times}"


def _write(played: Played) -> Files:
    """Write the files of a rover, and yield them with their descriptions."""
    folder, recorder, aboard = (
        played.folder,
        played.scene.recorder,
        played.scene.rover.aboard,
    )
    *drawn, reports = write_run(folder, played.scenario, played.record)
    yield tuple(drawn[:2]), "the drive: planned, driven by odometry, true"
    relayed = played.scene.orbiter is not None
    lanes = "each command between ground, orbiter and rover" if relayed else "command life cycles"
    yield tuple(drawn[2:]), f"{lanes}; modes, the true speed"
    pictures = sorted((aboard / "files/pictures").glob("*.jpg"))
    if pictures:
        picture = Path(shutil.copyfile(pictures[0], folder / "picture.jpg"))
        yield (picture,), "picture of the camera"
    if recorder.busiest is not None:
        tree = folder / "tree.svg"
        title = f"{recorder.busiest.mode}: {recorder.busiest.why}"
        tree.write_text(tree_as_svg(recorder.busiest.nodes, title), encoding="utf-8")
        yield (tree,), "the behaviour tree at its busiest"
    yield (reports,), "every received report, as JSON"
    yield (aboard,), "data folder of the executive: ledger and files"


def _write_all(played: Sequence[Played], folder: Path) -> Files:
    """Yield the files that all rovers share, with their descriptions."""
    fleet = played[0].scene.fleet
    if fleet.orbiter is not None:
        yield (fleet.orbiter.data,), "data folder of the orbiter: bundles and records"
    console = folder / "console"
    if console.exists():
        yield (console, folder / "console.log"), "archive and log of the operations console"
    yield (*fleet.processes.logs, folder / LOG), "logs of the processes"


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
