"""Shows sessions: tables that live on a terminal, one line an event elsewhere."""

import time
from collections.abc import Callable, Sequence
from math import degrees, isinf, isnan
from typing import Final, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from adapters.mrs.spec import Stage
from sim.demo.script import Ending, Link, Script
from sim.demo.session import Audience, Life, RelayStatus, RoverStatus


class SessionView:
    """Keeps what a session shows; its `Audience`.

    Args:
        script: what is played.
        heading: whose commands they are; empty where there is only one rover.
        show: called when there is something new, with the life that got further, if one did.

    Attributes:
        status: how the rover was last seen.
    """

    def __init__(
        self, script: Script, heading: str, show: "Callable[[SessionView, Life | None], None]"
    ) -> None:
        self.heading = heading
        self.status: RoverStatus | None = None
        self._links = script.links
        self._lives: list[Life] = []
        self._show = show

    def changed(self, life: Life) -> None:
        """Show a new command, or how one got further."""
        if life not in self._lives:
            self._lives.append(life)
        self._show(self, life)

    def looked(self, status: RoverStatus) -> None:
        """Show how the rover is."""
        self.status = status
        self._show(self, None)

    def table(self, *, brief: bool = False) -> RenderableType:
        """Return the lives, below the heading."""
        if not self._lives:
            return Text("")
        table = lives_table(self._lives, links=self._links, brief=brief)
        return Group(Text(self.heading, style="bold"), table) if self.heading else table

    def state(self) -> Text:
        """Return how the rover is, and the relay."""
        if self.status is None:
            return Text("")
        lines = [status_line(self.status)]
        if self.status.relay is not None:
            lines.append(relay_line(self.status.relay))
        return Text("\n").join(lines)


def status_line(status: RoverStatus) -> Text:
    """Return where the rover is and how it is about, in one line."""
    if isnan(status.x_m):
        return Text(f"{status.mode.name}, not located yet", style="dim")
    return Text.assemble(
        (f"{status.mode.name:<8}", "bold"),
        f" x {status.x_m:z6.2f} m  y {status.y_m:z6.2f} m"
        f"  heading {degrees(status.heading_rad):z6.1f}°"
        f"  speed {status.travel_mps:z5.2f} m/s  {status.battery_v:.1f} V",
    )


def relay_line(relay: RelayStatus) -> Text:
    """Return how the relay is doing, in one line."""
    contact: str | tuple[str, str] = ("contact ", "green")
    if relay.dark:
        next_s = relay.next_contact_s
        when = "none planned" if isinf(next_s) else f"next in {next_s:.0f} s"
        contact = (f"no contact, {when} ", "red")
    oldest = f", oldest {relay.oldest_s:.0f} s" if relay.oldest_s else ""
    heard = "" if isinf(relay.last_heard_s) else f"  heard {relay.last_heard_s:.0f} s ago"
    return Text.assemble(
        ("relay    ", "bold"), contact, f"  queue {relay.queued:.0f}{oldest}", heard
    )


COMMAND: Final = 28
"""Columns of a command, at most."""
_STYLE: Final = {
    Ending.EXECUTED: "green",
    Ending.CANCELLED: "yellow",
    Ending.REJECTED: "yellow",
    Ending.DUPLICATE: "yellow",
    Ending.FAILED: "red",
    Ending.EXPIRED: "red",
}


def lives_table(
    lives: Sequence[Life], *, links: frozenset[Link] = frozenset({Link.DIRECT}), brief: bool = False
) -> Table:
    """Return every command's life, times in seconds since the first command was made.

    Where the relay takes part, times at both ends are told, and by which link a command went. A
    brief table has a line for each command on a terminal of 80 columns.
    """
    relayed = Link.RELAY in links
    table = Table(box=None, pad_edge=False, header_style="dim", expand=brief)
    table.add_column("#", justify="right", style="dim", width=2)
    widest, narrow = (24, 14) if relayed else (COMMAND, 18)
    table.add_column("command", width=narrow if brief else None, max_width=widest, no_wrap=brief)
    columns = ["received", "accepted", "started", "ended"]
    if relayed:
        table.padding = (0, 1, 0, 0)
        table.add_column("link", width=6)
        columns = [
            "sent",
            "received\naboard",
            "started\naboard",
            "ended\naboard",
            "told on\nground",
        ]
        columns = [name for name in columns if not (brief and name.startswith("started"))]
    for name in columns:
        table.add_column(name, justify="right", width=max(5, *map(len, name.split("\n"))))
    table.add_column("outcome", ratio=1 if brief else None, no_wrap=brief)
    for number, life in enumerate(lives, 1):
        times = _relayed_utc_s(life, brief) if relayed else _aboard_utc_s(life)
        since = ("" if at is None else f"{at - lives[0].sent_utc_s:.2f}" for at in times)
        link = [life.step.link.value] if relayed else []
        table.add_row(str(number), life.spelled, *link, *since, outcome(life))
    return table


def _aboard_utc_s(life: Life) -> list[float | None]:
    """Return when it was received, accepted, started and ended, by the clock aboard."""
    stages = map(life.reached, (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED))
    return [told.aboard_utc_s if told else None for told in (*stages, life.ended)]


def _relayed_utc_s(life: Life, brief: bool) -> list[float | None]:
    received, _, started, ended = _aboard_utc_s(life)
    aboard = [received] if brief else [received, started]
    told_utc_s = life.ended.utc_s if life.ended else None
    return [life.sent_utc_s, *aboard, None if life.lost else ended, told_utc_s]


def outcome(life: Life) -> Text:
    """Return how far a command is, or how it ended."""
    ending, stage = life.ending, life.stage
    if ending is not None:
        return Text.assemble((ending.name, _STYLE[ending]), f"  {life.text}".rstrip())
    if stage is None:
        return Text("stored at the orbiter" if life.stored else "sent", style="dim")
    return Text.assemble((stage.name, "blue"), f"  {life.text}".rstrip())


WIDTH: Final = 110
"""Columns where the output is no terminal."""
_SHOWN: Final = (Stage.STARTED, Stage.PROGRESS)


def make_console() -> Console:
    """Return a console for standard output."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH)


class LineDisplay:
    """Prints a line when a command begins, gets further or ends; in the end, the tables."""

    def __init__(self, console: Console) -> None:
        self._views: list[SessionView] = []
        self._console = console
        self._start_s = time.monotonic()
        self._dark: dict[str, bool] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._console.print("")
        for view in self._views:
            self._console.print(view.table())

    def audience(self, script: Script, heading: str = "") -> Audience:
        """Return who is shown one more session, under a heading."""
        self._views.append(SessionView(script, heading, self._show))
        return self._views[-1]

    def _show(self, view: SessionView, life: Life | None) -> None:
        if life is None:
            self._tell_of_contact(view)
        elif life.ending is not None or life.stage in _SHOWN or (life.stored and not life.told):
            self._tell(view, life)

    def _tell(self, view: SessionView, life: Life) -> None:
        """Print what a command began, reached, or came to, and in the end where the rover is."""
        whose = f"{view.heading:<8}" if view.heading else ""
        said = f"{self._time()}  {whose}{_cut(life.spelled):<{COMMAND}}  "
        self._console.print(Text.assemble(said, outcome(life)), soft_wrap=True)
        if life.ending is not None:
            for line in view.state().split():
                self._console.print(Text(" " * 10), line, soft_wrap=True)

    def _tell_of_contact(self, view: SessionView) -> None:
        """Print that contact began or ended."""
        relay = None if view.status is None else view.status.relay
        if relay is not None and self._dark.get(view.heading, False) != relay.dark:
            self._dark[view.heading] = relay.dark
            self._console.print(Text(f"{self._time()}  "), relay_line(relay), soft_wrap=True)

    def _time(self) -> str:
        return f"{time.monotonic() - self._start_s:6.2f} s"


class TerminalDisplay(LineDisplay):
    """Redraws a line for each command, and the rovers' situations, in place."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._live = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        super().__exit__(*_)

    def _show(self, view: SessionView, life: Life | None) -> None:
        shown = [
            part
            for each in self._views
            for part in (each.table(brief=True), Text(""), each.state())
        ]
        self._live.update(Group(*shown), refresh=True)


def display(console: Console) -> LineDisplay:
    """Return the display that suits the console."""
    return TerminalDisplay(console) if console.is_terminal else LineDisplay(console)


def _cut(words: str) -> str:
    return words if len(words) <= COMMAND else f"{words[: COMMAND - 1]}…"
