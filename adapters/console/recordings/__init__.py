"""Recordings as assets with an archive each."""

from adapters.console.recordings.recordings import Recordings, is_connected

__all__ = [
    "Recordings",
    "is_connected",
]
