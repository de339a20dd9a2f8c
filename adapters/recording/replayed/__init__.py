"""The core on recorded inputs, for replays and forks; imports all of the executive."""

from adapters.recording.first_decision import differing as differing
from adapters.recording.messages import encode as encode
from adapters.recording.messages import topic_of as topic_of
from adapters.recording.replayed.core import RecordedEntry as RecordedEntry
from adapters.recording.replayed.core import ReplayedCore as ReplayedCore
from adapters.recording.replayed.core import read_entries as read_entries
from adapters.recording.replayed.core import write_files as write_files
from adapters.recording.run_file import RecordedMessage as RecordedMessage
