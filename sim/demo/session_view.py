"""What is shown of one rover while its session is played: its commands, how it is, the relay.

Commands are told as tables: by one link, or by two with the times at both ends.
"""

from collections.abc import Callable, Sequence
from math import degrees, isinf, isnan
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from adapters.mrs.spec import Stage
from sim.demo.life import Life, Told
from sim.demo.script import Ending, Link, Script
from sim.demo.session import RelayStatus, RoverStatus


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
_BRIEF: Final = 18
_RELAYED: Final = 24
_RELAYED_BRIEF: Final = 14
"""Columns of a command, at most, and on the line of a command that is under way."""
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
    """Return every command's life, times in seconds since the first command was made."""
    return _relayed(lives, brief) if Link.RELAY in links else _direct(lives, brief)


def outcome(life: Life) -> Text:
    """Return how far a command is, or how it ended."""
    ending, stage = life.ending, life.stage
    if ending is not None:
        return Text.assemble((ending.name, _STYLE[ending]), f"  {life.text}".rstrip())
    if stage is None:
        return Text("stored at the orbiter" if life.stored else "sent", style="dim")
    return Text.assemble((stage.name, "blue"), f"  {life.text}".rstrip())


def _direct(lives: Sequence[Life], brief: bool) -> Table:
    table = _table(brief, COMMAND, _BRIEF)
    for name in ("received", "accepted", "started", "ended"):
        table.add_column(name, justify="right", width=len(name))
    table.add_column("outcome", ratio=1 if brief else None, no_wrap=brief)
    for number, life in enumerate(lives, 1):
        stages = map(life.reached, (Stage.RECEIVED, Stage.ACCEPTED, Stage.STARTED))
        times = [_since(lives, _aboard_utc_s(told)) for told in (*stages, life.ended)]
        table.add_row(str(number), life.spelled, *times, outcome(life))
    return table


def _relayed(lives: Sequence[Life], brief: bool) -> Table:
    table = _table(brief, _RELAYED, _RELAYED_BRIEF)
    table.padding = (0, 1, 0, 0)
    table.add_column("link", width=6)
    columns = ("sent", "received\naboard", "ended\naboard", "told on\nground")
    for name in columns if brief else (*columns[:2], "started\naboard", *columns[2:]):
        table.add_column(name, justify="right", width=max(5, *map(len, name.split("\n"))))
    table.add_column("outcome", ratio=1 if brief else None, no_wrap=brief)
    for number, life in enumerate(lives, 1):
        stages = (Stage.RECEIVED,) if brief else (Stage.RECEIVED, Stage.STARTED)
        ended = None if life.lost else life.ended
        aboard: list[Told | None] = [*map(life.reached, stages), ended]
        table.add_row(
            str(number),
            life.spelled,
            life.step.link.value,
            _since(lives, life.sent_utc_s),
            *(_since(lives, _aboard_utc_s(told)) for told in aboard),
            _since(lives, life.ended.utc_s if life.ended else None),
            outcome(life),
        )
    return table


def _table(brief: bool, width: int, brief_width: int) -> Table:
    table = Table(box=None, pad_edge=False, header_style="dim", expand=brief)
    table.add_column("#", justify="right", style="dim", width=2)
    table.add_column(
        "command", width=brief_width if brief else None, max_width=width, no_wrap=brief
    )
    return table


def _aboard_utc_s(told: Told | None) -> float | None:
    return None if told is None else told.aboard_utc_s


def _since(lives: Sequence[Life], at_utc_s: float | None) -> str:
    return "" if at_utc_s is None else f"{at_utc_s - lives[0].sent_utc_s:.2f}"
