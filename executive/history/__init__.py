"""The history of a run, read by all that displays or explains it.

`HistoryBuilder` folds recorded items into a `RunHistory`: from a file, or while the executive runs.
`MotionTracks` stores the rover's poses and velocities.
"""

from executive.history.history_builder import KINDS as KINDS
from executive.history.history_builder import HistoryBuilder as HistoryBuilder
from executive.history.motion_tracks import TRACK_KINDS as TRACK_KINDS
from executive.history.motion_tracks import MotionTracks as MotionTracks
from executive.history.motion_tracks import PoseAt as PoseAt
from executive.history.motion_tracks import TrackSource as TrackSource
from executive.history.motion_tracks import VelocityAt as VelocityAt
from executive.history.run_history import CommandHistory as CommandHistory
from executive.history.run_history import LeafRun as LeafRun
from executive.history.run_history import PeakSpeed as PeakSpeed
from executive.history.run_history import ReceivedCommand as ReceivedCommand
from executive.history.run_history import RejectedSubmission as RejectedSubmission
from executive.history.run_history import RunHistory as RunHistory
from executive.history.run_history import Situation as Situation
