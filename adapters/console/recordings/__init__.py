"""Recordings as assets with an archive each."""

from adapters.console.recordings.recordings import Recordings

__all__ = [
    "Recordings",
]
