"""Shows sessions: tables that live on a terminal, one line an event elsewhere."""

import time
from typing import Final, Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from adapters.mrs.spec import Stage
from sim.demo.life import Life
from sim.demo.script import Script
from sim.demo.session import Audience
from sim.demo.session_view import COMMAND, SessionView, outcome, relay_line

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
        self._close()
        for view in self._views:
            self._console.print(view.table())

    def _close(self) -> None:
        self._console.print("")

    def audience(self, script: Script, heading: str = "") -> Audience:
        """Return who is shown one more session, under a heading."""
        self._views.append(SessionView(script, heading, self._show))
        return self._views[-1]

    def _show(self, view: SessionView, life: Life | None) -> None:
        if life is None:
            self._tell_of_contact(view)
        elif life.ending is not None or life.stage in _SHOWN or _only_stored(life):
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

    def _close(self) -> None:
        self._live.stop()

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


def _only_stored(life: Life) -> bool:
    return life.stored and not life.told


def _cut(words: str) -> str:
    return words if len(words) <= COMMAND else f"{words[: COMMAND - 1]}…"
