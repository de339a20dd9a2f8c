"""Displays the sessions of the demonstration: tables on a terminal, else one line per event."""

import time
from collections.abc import Callable, Iterable, Sequence
from math import degrees, inf, isinf, nan
from typing import Final, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from adapters.mrs.ground import DTN_OLDEST_AGE, DTN_QUEUED, LAST_RECEIVED, NEXT_CONTACT
from executive.values.parameters import Parameter
from executive.values.reports import Stage
from sim.scenario.record import Receipt, Record, SeenStatus
from sim.scenario.sent import DUPLICATE, RELAY, CommandTrace, sent_commands


class SessionView:
    """Displayed state of one session.

    Args:
        links: links of the session; the rover's status is displayed from the first one.
        heading: rover of the commands; empty if there is only one rover.
        show: called on each change, with the command rover state changed, or None.

    Attributes:
        status: last received status of the rover.
    """

    def __init__(
        self,
        links: Sequence[str],
        heading: str,
        show: "Callable[[SessionView, CommandTrace | None], None]",
    ) -> None:
        self.heading = heading
        self.status: SeenStatus | None = None
        self._links, self._show = links, show
        self._sent: list[CommandTrace] = []

    def on_update(self, record: Record) -> None:
        """Display the changes in a record."""
        before, self._sent = self._sent, list(sent_commands(record))
        last = record.statuses[-1] if record.statuses else None
        for number, sent in enumerate(self._sent):
            if number >= len(before) or sent != before[number]:
                self._show(self, sent)
        if last is not None and last.link == self._links[0] and last is not self.status:
            self.status = last
            self._show(self, None)

    def table(self, *, brief: bool = False) -> RenderableType:
        """Return the table of commands, below the heading."""
        if not self._sent:
            return Text("")
        table = commands_table(self._sent, relayed=RELAY in self._links, brief=brief)
        return Group(Text(self.heading, style="bold"), table) if self.heading else table

    def state(self) -> Text:
        """Return the status lines of the rover and of the relay."""
        if self.status is None:
            return Text("")
        lines = [status_line(self.status)]
        if self.status.link == RELAY:
            lines.append(relay_line(self.status))
        return Text("\n").join(lines)


def status_line(status: SeenStatus) -> Text:
    """Return mode, pose, speed and battery voltage of the rover in one line, and a long age."""
    x_m, y_m, heading_rad, travel_mps, battery_v = (
        status.values.get(each.value, nan)
        for each in (
            Parameter.POS_X,
            Parameter.POS_Y,
            Parameter.HEAD,
            Parameter.CURRENT_TRAVEL_SPEED,
            Parameter.BATERY_VOLTAGE,
        )
    )
    mode = "OFFLINE" if status.mode is None else status.mode.name
    age = f"  {status.age_s:.1f} s old" if status.age_s >= NOTICEABLE_AGE_S else ""
    return Text.assemble(
        (f"{mode:<8}", "bold"),
        f" x {x_m:z6.2f} m  y {y_m:z6.2f} m  heading {degrees(heading_rad):z6.1f}°"
        f"  speed {travel_mps:z5.2f} m/s  {battery_v:.1f} V{age}",
    )


def relay_line(status: SeenStatus) -> Text:
    """Return the state of the relay in one line; unknown values are infinite."""
    queued, max_age_s, next_s, last_s = (
        status.values.get(name, inf)
        for name in (DTN_QUEUED, DTN_OLDEST_AGE, NEXT_CONTACT, LAST_RECEIVED)
    )
    contact: str | tuple[str, str] = ("contact ", "green")
    if next_s > 0:
        when = "none planned" if isinf(next_s) else f"next in {next_s:.0f} s"
        contact = (f"no contact, {when} ", "red")
    age_text = f", waiting up to {max_age_s:.0f} s" if max_age_s else ""
    last = "" if isinf(last_s) else f"  last contact {last_s:.0f} s ago"
    return Text.assemble(("relay    ", "bold"), contact, f"  queue {queued:.0f}{age_text}", last)


NOTICEABLE_AGE_S: Final = 1.0
"""Minimum age of a status that is displayed with it, s: that of several polls."""
COMMAND: Final = 32
"""Maximum width of a command, in columns."""
_STYLE: Final = {
    Stage.EXECUTED.name: "green",
    Stage.CANCELLED.name: "yellow",
    Stage.REJECTED.name: "yellow",
    DUPLICATE: "yellow",
}


def commands_table(
    commands: Sequence[CommandTrace], *, relayed: bool = False, brief: bool = False
) -> Table:
    """Return the life cycle of every command; times in seconds since the first was sent.

    With a relay the table shows the times at both ends and the link of each command. A brief
    table has one line per command on a terminal of 80 columns.
    """
    table = Table(box=None, pad_edge=False, header_style="dim", expand=brief)
    table.add_column("#", justify="right", style="dim", width=2)
    widest, narrow = (24, 14) if relayed else (COMMAND, 18)
    table.add_column("command", width=narrow if brief else None, max_width=widest, no_wrap=brief)
    columns = ["received", "accepted", "started", "ended"]
    if relayed:
        table.padding = (0, 1, 0, 0)
        table.add_column("link", width=6)
        columns = ["sent", "received\naboard", "started\naboard", "ended\naboard", "on\nground"]
        columns = [name for name in columns if not (brief and name.startswith("started"))]
    for name in columns:
        table.add_column(name, justify="right", width=max(6, *map(len, name.split("\n"))))
    table.add_column("outcome", ratio=1 if brief else None, no_wrap=brief)
    for number, sent in enumerate(commands, 1):
        times = _relayed_s(sent, brief) if relayed else _aboard_s(sent)
        since = ("" if at is None else f"{at - commands[0].sending.time_s:.2f}" for at in times)
        link = [sent.link] if relayed else []
        table.add_row(str(number), sent.title, *link, *since, outcome(sent))
    return table


def _aboard_s(sent: CommandTrace) -> list[float | None]:
    """Return the times of RECEIVED, ACCEPTED, STARTED and the end, by the onboard clock."""
    stages: Iterable[Receipt | None] = map(sent.at, (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED))
    return [None if each is None else each.made_s for each in (*stages, sent.ended)]


def _relayed_s(sent: CommandTrace, brief: bool) -> list[float | None]:
    received, _, started, ended = _aboard_s(sent)
    aboard = [received] if brief else [received, started]
    ground_s = None if sent.ended is None else sent.ended.time_s
    return [sent.sending.time_s, *aboard, None if sent.expiry else ended, ground_s]


def outcome(sent: CommandTrace) -> Text:
    """Return the current stage of a command, or how it ended."""
    ending, stage = sent.ending, sent.stage
    if ending is not None:
        return Text.assemble((ending, _STYLE.get(ending, "red")), f"  {sent.text}".rstrip())
    if stage is None:
        return Text("stored at the orbiter" if sent.stored else "sent", style="dim")
    return Text.assemble((stage.name, "blue"), f"  {sent.text}".rstrip())


WIDTH: Final = 110
"""Width of output that is no terminal, in columns."""
_SHOWN: Final = (Stage.STARTED, Stage.PROGRESS)


def make_console() -> Console:
    """Return a console for standard output."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH)


class LineDisplay:
    """Prints a line when a command starts, progresses or ends; at the end the tables."""

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

    def view(self, links: Sequence[str], heading: str = "") -> SessionView:
        """Add a session and return its view, under a heading."""
        self._views.append(SessionView(links, heading, self._show))
        return self._views[-1]

    def _show(self, view: SessionView, sent: CommandTrace | None) -> None:
        if sent is None:
            self._show_contact(view)
        elif sent.ending or sent.stage in _SHOWN or (sent.stored and not sent.receipts):
            rover = f"{view.heading:<8}" if view.heading else ""
            begin = f"{self._time()}  {rover}{_cut(sent.title):<{COMMAND}}  "
            self._console.print(Text.assemble(begin, outcome(sent)), soft_wrap=True)
            if sent.ending:
                for line in view.state().split():
                    self._console.print(Text(" " * 10), line, soft_wrap=True)

    def _show_contact(self, view: SessionView) -> None:
        """Print a status line when contact begins or ends."""
        status = view.status
        if status is None or status.link != RELAY:
            return
        dark = status.values.get(NEXT_CONTACT, inf) > 0
        if self._dark.get(view.heading, False) != dark:
            self._dark[view.heading] = dark
            self._console.print(Text(f"{self._time()}  "), relay_line(status), soft_wrap=True)

    def _time(self) -> str:
        return f"{time.monotonic() - self._start_s:6.2f} s"


class TerminalDisplay(LineDisplay):
    """Redraws one line per command and the state of the rovers in place."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._live = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        super().__exit__(*_)

    def _show(self, view: SessionView, sent: CommandTrace | None) -> None:
        shown = [
            part
            for each in self._views
            for part in (each.table(brief=True), Text(""), each.state())
        ]
        self._live.update(Group(*shown), refresh=True)


def display(console: Console) -> LineDisplay:
    """Return the display that suits the console."""
    return TerminalDisplay(console) if console.is_terminal else LineDisplay(console)


def _cut(text: str) -> str:
    return text if len(text) <= COMMAND else f"{text[: COMMAND - 1]}…"
