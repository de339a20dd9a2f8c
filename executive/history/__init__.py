"""The history of a run, which all that show or explain what happened read.

`HistoryBuilder` folds recorded items into a `RunHistory`: from a file, or while the executive runs.
"""

from executive.history.history_builder import KINDS, HistoryBuilder
from executive.history.run_history import (
    CommandLife,
    Declined,
    Fastest,
    LeafRun,
    ReceivedCommand,
    RunHistory,
    Situation,
)

__all__ = [
    "KINDS",
    "CommandLife",
    "Declined",
    "Fastest",
    "HistoryBuilder",
    "LeafRun",
    "ReceivedCommand",
    "RunHistory",
    "Situation",
]
