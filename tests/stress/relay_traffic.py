"""What goes up: numbered commands, each known by its number; and the journals of what came."""

from pathlib import Path
from typing import Final

from adapters.mops import Dictionary
from executive.commands import Command, SetTravelSpeed
from executive.reports import Identity

ASSET: Final = "jackal"
NAME: Final = "JACKAL"
SOURCE: Final = "MOE"
EACH_LIFE: Final = 1_000_000
"""Numbers for each life of the orbiter: none is given twice, whatever is known of it."""


def command_of(number: int) -> Command:
    """Return the command of a number."""
    speed_mps = 0.01 * (1 + number % 97)
    return Command(Identity(SOURCE, number), SetTravelSpeed(speed_mps), "direct")


def string_of(number: int, dictionary: Dictionary) -> str:
    """Return the command of a number as it must stand on the topic."""
    command = command_of(number)
    return str(dictionary.command(command.request, command.identity, NAME))


def read_lines(path: Path) -> list[str]:
    """Return the lines of a journal, but for a last one that a kill has cut."""
    return path.read_text(encoding="utf-8").split("\n")[:-1] if path.exists() else []
