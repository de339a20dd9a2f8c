"""`RunHistory`: the history of a run, the input of logs, explanations and displays.

`history_builder` folds recorded items into a `RunHistory`: from a file, or while the executive
runs. `motion_tracks` stores the rover's poses and velocities. Both import much of the core, so they
are imported by name, where they are used.
"""

from executive.history.run_history import DISK_WAIT as DISK_WAIT
from executive.history.run_history import CommandHistory as CommandHistory
from executive.history.run_history import LeafRun as LeafRun
from executive.history.run_history import PeakSpeed as PeakSpeed
from executive.history.run_history import ReceivedCommand as ReceivedCommand
from executive.history.run_history import RejectedSubmission as RejectedSubmission
from executive.history.run_history import RunHistory as RunHistory
from executive.history.run_history import Situation as Situation
