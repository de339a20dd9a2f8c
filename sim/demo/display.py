"""Shows sessions: tables that live on a terminal, one line an event elsewhere."""

import time
from types import TracebackType
from typing import Final, Protocol, Self

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


class Display(Protocol):
    """Shows sessions while it is entered, and their tables in the end."""

    def __enter__(self) -> Self:
        """Begin."""
        ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Print the tables."""
        ...

    def audience(self, script: Script, heading: str = "") -> Audience:
        """Return who is shown one more session, under a heading."""
        ...


class TerminalDisplay:
    """Redraws a line for each command, and the rovers' situations, in place."""

    def __init__(self, console: Console) -> None:
        self._boards: list[SessionView] = []
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
        _print_tables(self._console, self._boards)

    def audience(self, script: Script, heading: str = "") -> Audience:
        """Return who is shown one more session, under a heading."""
        self._boards.append(SessionView(script, heading, lambda *_: self._draw()))
        return self._boards[-1]

    def _draw(self) -> None:
        shown = [
            part
            for board in self._boards
            for part in (board.table(brief=True), Text(""), board.state())
        ]
        self._live.update(Group(*shown), refresh=True)


class LineDisplay:
    """Prints a line when a command begins, gets further or ends, for files and pipes."""

    def __init__(self, console: Console) -> None:
        self._boards: list[SessionView] = []
        self._console = console
        self._start_s = time.monotonic()
        self._dark: dict[str, bool] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._console.print("")
        _print_tables(self._console, self._boards)

    def audience(self, script: Script, heading: str = "") -> Audience:
        """Return who is shown one more session, under a heading."""
        self._boards.append(SessionView(script, heading, self._show))
        return self._boards[-1]

    def _show(self, board: SessionView, life: Life | None) -> None:
        if life is None:
            self._tell_of_contact(board)
        elif life.ending is not None or life.stage in _SHOWN or _only_stored(life):
            self._tell(board, life)

    def _tell(self, board: SessionView, life: Life) -> None:
        """Print what a command began, reached, or came to, and in the end where the rover is."""
        whose = f"{board.heading:<8}" if board.heading else ""
        said = f"{self._time()}  {whose}{_cut(life.spelled):<{COMMAND}}  "
        self._console.print(Text.assemble(said, outcome(life)), soft_wrap=True)
        if life.ending is not None:
            for line in board.state().split():
                self._console.print(Text(" " * 10), line, soft_wrap=True)

    def _tell_of_contact(self, board: SessionView) -> None:
        """Print that contact began or ended."""
        sky = None if board.situation is None else board.situation.sky
        if sky is not None and self._dark.get(board.heading, False) != sky.dark:
            self._dark[board.heading] = sky.dark
            self._console.print(Text(f"{self._time()}  "), relay_line(sky), soft_wrap=True)

    def _time(self) -> str:
        return f"{time.monotonic() - self._start_s:6.2f} s"


def display(console: Console) -> Display:
    """Return the display that suits the console."""
    return TerminalDisplay(console) if console.is_terminal else LineDisplay(console)


def _print_tables(console: Console, boards: list[SessionView]) -> None:
    for board in boards:
        console.print(board.table())


def _only_stored(life: Life) -> bool:
    return life.stored and not life.told


def _cut(words: str) -> str:
    return words if len(words) <= COMMAND else f"{words[: COMMAND - 1]}…"
