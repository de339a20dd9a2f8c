"""Recordings of runs as MCAP files: written, read, and replayed through the core."""

from adapters.recording.messages import decode
from adapters.recording.run_file import PROFILE, RecordingError, RunFile, RunReader

__all__ = ["PROFILE", "RecordingError", "RunFile", "RunReader", "decode"]
