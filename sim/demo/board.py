"""What is shown of one rover while its session is played: its commands, how it is, the relay."""

from collections.abc import Callable
from math import degrees, isinf, isnan

from rich.console import Group, RenderableType
from rich.text import Text

from sim.demo.life import Life
from sim.demo.script import Link, Script
from sim.demo.situation import Situation, Sky
from sim.demo.tables import lives_table


class Board:
    """Keeps what a session shows; its `Audience`.

    Args:
        script: what is played.
        heading: whose commands they are; empty where there is only one rover.
        show: called when there is something new, with the life that got further, if one did.

    Attributes:
        situation: how the rover was last seen.
    """

    def __init__(
        self, script: Script, heading: str, show: "Callable[[Board, Life | None], None]"
    ) -> None:
        """Show nothing yet."""
        self.heading = heading
        self.situation: Situation | None = None
        self._links = script.links
        self._lives: list[Life] = []
        self._show = show

    @property
    def relayed(self) -> bool:
        """Whether commands go by the relay too."""
        return Link.RELAY in self._links

    def changed(self, life: Life) -> None:
        """Show a new command, or how one got further."""
        if life not in self._lives:
            self._lives.append(life)
        self._show(self, life)

    def looked(self, situation: Situation) -> None:
        """Show how the rover is."""
        self.situation = situation
        self._show(self, None)

    def table(self, *, brief: bool = False) -> RenderableType:
        """Return the lives, below the heading."""
        if not self._lives:
            return Text("")
        table = lives_table(self._lives, links=self._links, brief=brief)
        return Group(Text(self.heading, style="bold"), table) if self.heading else table

    def state(self) -> Text:
        """Return how the rover is, and the relay."""
        if self.situation is None:
            return Text("")
        lines = [situation_line(self.situation)]
        if self.situation.sky is not None:
            lines.append(sky_line(self.situation.sky))
        return Text("\n").join(lines)


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


def sky_line(sky: Sky) -> Text:
    """Return how the relay is doing, in one line."""
    contact: str | tuple[str, str] = ("contact ", "green")
    if sky.dark:
        next_s = sky.next_contact_s
        when = "none planned" if isinf(next_s) else f"next in {next_s:.0f} s"
        contact = (f"no contact, {when} ", "red")
    oldest = f", oldest {sky.oldest_s:.0f} s" if sky.oldest_s else ""
    heard = "" if isinf(sky.last_heard_s) else f"  heard {sky.last_heard_s:.0f} s ago"
    return Text.assemble(("relay    ", "bold"), contact, f"  queue {sky.queued:.0f}{oldest}", heard)
