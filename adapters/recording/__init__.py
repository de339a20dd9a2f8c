"""Recordings of runs as MCAP files: written, read, and replayed through the core."""

from adapters.recording.background import BackgroundTape
from adapters.recording.completion import complete
from adapters.recording.container import RecordingError
from adapters.recording.messages import decode
from adapters.recording.moments import Moment, RecordedMoments
from adapters.recording.run_file import PROFILE, SUFFIX, RunFile, RunReader
from adapters.recording.tables import frames
from adapters.recording.timed import Timed, read_history, read_timed
from adapters.recording.tree import RecordedTree

__all__ = [
    "PROFILE",
    "SUFFIX",
    "BackgroundTape",
    "Moment",
    "RecordedMoments",
    "RecordedTree",
    "RecordingError",
    "RunFile",
    "RunReader",
    "Timed",
    "complete",
    "decode",
    "frames",
    "read_history",
    "read_timed",
]
