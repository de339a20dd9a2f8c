"""The numbered commands that go up, and the journals of what came where."""

from typing import Final

from adapters.mops import Dictionary
from executive.commands.catalogue import Command, SetTravelSpeed
from executive.values.reports import Identity

ASSET: Final = "jackal"
NAME: Final = "JACKAL"
SOURCE: Final = "MOE"
EACH_RUN: Final = 1_000_000
"""Numbers for each life of the orbiter: none is given twice, whatever is known of it."""
TOPIC_JOURNAL: Final = "topic.jsonl"
"""A row for each string on the topic of commands."""
ROVER_LEDGER: Final = "rover.sqlite"
ORBITER_JOURNAL: Final = "orbiter.jsonl"
"""Rows of the orbiter; the first column is one of those below."""
REQUESTED, ACKNOWLEDGED, REFUSED = "asked", "acknowledged", "refused"
"""Number of a command that is about to be sent; acknowledged, or known when sent again; refused."""
REPORTED, GIVEN = "told", "given"
"""Life, and number of a report that was told to the ground; life, and bundle that came down."""


def command_of(number: int) -> Command:
    speed_mps = 0.01 * (1 + number % 97)
    return Command(Identity(SOURCE, number), SetTravelSpeed(speed_mps), "direct")


def string_of(number: int, dictionary: Dictionary) -> str:
    """Return the command of a number as it must stand on the topic."""
    command = command_of(number)
    return str(dictionary.command(command.request, command.identity, NAME))
