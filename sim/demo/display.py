"""Shows the session: a table that lives on a terminal, one line an event elsewhere."""

import time
from collections.abc import Sequence
from math import degrees, isnan
from types import TracebackType
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from adapters.mrs.types import Stage
from sim.demo.life import Life
from sim.demo.script import Ending
from sim.demo.session import Situation

WIDTH: Final = 110
"""Columns where the output is no terminal."""
_STYLE: Final = {
    Ending.EXECUTED: "green",
    Ending.CANCELLED: "yellow",
    Ending.REJECTED: "yellow",
    Ending.DUPLICATE: "yellow",
    Ending.FAILED: "red",
    Ending.EXPIRED: "red",
}
_COMMAND: Final = 28
_BRIEF: Final = 18
"""Columns of a command, at most, and on the line of a command that is under way."""
_TIMED: Final = (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED)


def make_console() -> Console:
    """Return a console for standard output."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=WIDTH)


def lives_table(lives: Sequence[Life], *, brief: bool = False) -> Table:
    """Return every command's life, times in seconds since the first command was made.

    Args:
        lives: in the order in which they were sent.
        brief: cut what is too long for one line.
    """
    table = Table(box=None, pad_edge=False, header_style="dim", expand=brief)
    table.add_column("#", justify="right", style="dim", width=2)
    width = _BRIEF if brief else None
    table.add_column("command", width=width, max_width=_COMMAND, no_wrap=brief)
    for name in ("received", "accepted", "started", "ended"):
        table.add_column(name, justify="right", width=len(name))
    table.add_column("outcome", ratio=1 if brief else None, no_wrap=brief)
    for number, life in enumerate(lives, 1):
        start_s = lives[0].command.created_utc_s or 0.0
        times = [*(life.utc_s(stage) for stage in _TIMED), life.ended_utc_s]
        table.add_row(
            str(number),
            life.spelled,
            *("" if at_s is None else f"{at_s - start_s:.2f}" for at_s in times),
            _outcome(life),
        )
    return table


def situation_line(situation: Situation) -> Text:
    """Return where the rover is and how it is about, in one line."""
    if isnan(situation.x_m):
        return Text(f"{situation.mode.name}, not located yet", style="dim")
    return Text.assemble(
        (f"{situation.mode.name:<8}", "bold"),
        f" x {situation.x_m:z6.2f} m  y {situation.y_m:z6.2f} m"
        f"  heading {degrees(situation.heading_rad):z6.1f}°"
        f"  speed {situation.travel_mps:z5.2f} m/s  {situation.battery_v:.1f} V",
    )


class TerminalDisplay:
    """Redraws a line for each command, and the rover's situation, in place."""

    def __init__(self, console: Console) -> None:
        """Show nothing yet."""
        self._lives: list[Life] = []
        self._situation = Text("")
        self._console = console
        self._live = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._live.stop()
        self._console.print(lives_table(self._lives))

    def changed(self, life: Life) -> None:
        """Show a new command, or how one got further."""
        if life not in self._lives:
            self._lives.append(life)
        self._draw()

    def looked(self, situation: Situation) -> None:
        """Show how the rover is."""
        self._situation = situation_line(situation)
        self._draw()

    def _draw(self) -> None:
        lives = lives_table(self._lives, brief=True)
        self._live.update(Group(lives, Text(""), self._situation), refresh=True)


class LineDisplay:
    """Prints a line when a command begins, gets further or ends, for files and pipes."""

    def __init__(self, console: Console) -> None:
        """Print nothing yet."""
        self._lives: list[Life] = []
        self._console = console
        self._start_s = time.monotonic()
        self._situation = Text("")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._lives:
            self._console.print("")
            self._console.print(lives_table(self._lives))

    def changed(self, life: Life) -> None:
        """Print what the command began, reached, or came to, and in the end where the rover is."""
        if life not in self._lives:
            self._lives.append(life)
        if life.ending is None and life.stage not in (Stage.STARTED, Stage.PROGRESS):
            return
        said = Text.assemble(f"{self._time()}  {_cut(life.spelled):<{_COMMAND}}  ", _outcome(life))
        self._console.print(said, soft_wrap=True)
        if life.ending is not None:
            self._console.print(Text(" " * 10), self._situation, soft_wrap=True)

    def looked(self, situation: Situation) -> None:
        """Remember how the rover is."""
        self._situation = situation_line(situation)

    def _time(self) -> str:
        return f"{time.monotonic() - self._start_s:6.2f} s"


def display(console: Console) -> TerminalDisplay | LineDisplay:
    """Return the display that suits the console."""
    return TerminalDisplay(console) if console.is_terminal else LineDisplay(console)


def _cut(words: str) -> str:
    return words if len(words) <= _COMMAND else f"{words[: _COMMAND - 1]}…"


def _outcome(life: Life) -> Text:
    ending, stage = life.ending, life.stage
    if ending is not None:
        return Text.assemble((ending.name, _STYLE[ending]), f"  {life.text}".rstrip())
    if stage is None:
        return Text("sent", style="dim")
    return Text.assemble((stage.name, "blue"), f"  {life.text}".rstrip())
