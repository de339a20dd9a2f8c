"""What happened to a rover and its commands, and why, in words: from recordings and by the MRS.

All of it is pure. One value goes in, a `RunHistory`: of a recording, of an executive that runs, or
from `MrsClient.get_history`. An `Explanation` or the entries of a log come out.
"""

from adapters.explanation.explain import (
    Explanation,
    Step,
    UnknownCommandError,
    explain_command,
    explain_now,
)
from adapters.explanation.log import Entry, Wanted, entries
from adapters.explanation.relevance import relevant
from adapters.explanation.words import When, entry_line, explanation_lines

__all__ = [
    "Entry",
    "Explanation",
    "Step",
    "UnknownCommandError",
    "Wanted",
    "When",
    "entries",
    "entry_line",
    "explain_command",
    "explain_now",
    "explanation_lines",
    "relevant",
]
