"""Recordings as assets, each with its own archive."""

from adapters.console.recordings.recordings import Recordings as Recordings
from adapters.console.recordings.recordings import is_connected as is_connected
