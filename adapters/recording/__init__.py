"""Recordings of runs as MCAP files: written, read, and replayed through the core."""

from adapters.recording.run_file import PROFILE, RecordingError, RunFile

__all__ = ["PROFILE", "RecordingError", "RunFile"]
