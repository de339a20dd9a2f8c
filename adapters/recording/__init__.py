"""Recordings of runs as MCAP files: writer, reader, and replay through the core."""

from adapters.recording.background import BackgroundRecorder as BackgroundRecorder
from adapters.recording.background import complete as complete
from adapters.recording.container import RecordingError as RecordingError
from adapters.recording.messages import TOPICS as TOPICS
from adapters.recording.messages import decode as decode
from adapters.recording.messages import missing_for_fork as missing_for_fork
from adapters.recording.messages import plain_of as plain_of
from adapters.recording.messages import topic_of as topic_of
from adapters.recording.moments import Moment as Moment
from adapters.recording.moments import RecordedMoments as RecordedMoments
from adapters.recording.moments import RecordedTree as RecordedTree
from adapters.recording.run_file import PROFILE as PROFILE
from adapters.recording.run_file import SUFFIX as SUFFIX
from adapters.recording.run_file import RunFile as RunFile
from adapters.recording.run_file import RunReader as RunReader
from adapters.recording.timed_items import TimedItem as TimedItem
from adapters.recording.timed_items import frames as frames
from adapters.recording.timed_items import read_history as read_history
from adapters.recording.timed_items import read_timed as read_timed
