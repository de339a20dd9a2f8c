"""Recordings that the console shows as assets, each with an archive of its own."""

from adapters.console.recordings.recordings import Recordings as Recordings
from adapters.console.recordings.recordings import is_connected as is_connected
