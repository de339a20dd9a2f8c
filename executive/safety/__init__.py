"""What the executive watches for, and when a fault begins and ends."""

from executive.safety.camera_checks import END_WITHIN, frame_fault
from executive.safety.channel import Channel
from executive.safety.coverage import Unmonitored, summary, unmonitored
from executive.safety.evidence import Evidence, Monitor
from executive.safety.history import History, Moved
from executive.safety.pose_uncertainty import PoseMonitor, StoredPose
from executive.safety.safety import HOLDING, MONITORS, Changes, Fault, Safety

__all__ = [
    "END_WITHIN",
    "HOLDING",
    "MONITORS",
    "Changes",
    "Channel",
    "Evidence",
    "Fault",
    "History",
    "Monitor",
    "Moved",
    "PoseMonitor",
    "Safety",
    "StoredPose",
    "Unmonitored",
    "frame_fault",
    "summary",
    "unmonitored",
]
