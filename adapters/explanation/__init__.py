"""What happened to a rover and its commands, and why, in words: from recordings and by the MRS.

All of it is pure. One value goes in, a `Chronicle`: `builder` makes it of what an executive
records, read from a file or while it runs, and `MrsClient.get_history` returns one. An
`Explanation` or the entries of a log come out.
"""

from adapters.explanation.chronicle import (
    Asked,
    Chronicle,
    Declined,
    Fastest,
    LeafRun,
    Situation,
    request_text,
)
from adapters.explanation.explain import (
    Explanation,
    Step,
    UnknownCommandError,
    explain_command,
    explain_now,
)
from adapters.explanation.log import CommandLife, Entry, Wanted, entries, lives_of
from adapters.explanation.relevance import relevant
from adapters.explanation.words import When, entry_line, explanation_lines

__all__ = [
    "Asked",
    "Chronicle",
    "CommandLife",
    "Declined",
    "Entry",
    "Explanation",
    "Fastest",
    "LeafRun",
    "Situation",
    "Step",
    "UnknownCommandError",
    "Wanted",
    "When",
    "entries",
    "entry_line",
    "explain_command",
    "explain_now",
    "explanation_lines",
    "lives_of",
    "relevant",
    "request_text",
]
