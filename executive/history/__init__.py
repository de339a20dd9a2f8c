"""The history of a run, which all that show or explain what happened read.

`HistoryBuilder` folds recorded items into a `RunHistory`: from a file, or while the executive runs.
`MotionTracks` keeps where the rover was, and how fast it went.
"""

from executive.history.history_builder import KINDS, HistoryBuilder
from executive.history.motion_tracks import KINDS as TRACK_KINDS
from executive.history.motion_tracks import MotionTracks, PoseAt, TrackSource, VelocityAt
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
    "TRACK_KINDS",
    "CommandLife",
    "Declined",
    "Fastest",
    "HistoryBuilder",
    "LeafRun",
    "MotionTracks",
    "PoseAt",
    "ReceivedCommand",
    "RunHistory",
    "Situation",
    "TrackSource",
    "VelocityAt",
]
