"""Fault monitors: which faults are detected, and when a fault begins and ends."""

from executive.safety.channel import Channel as Channel
from executive.safety.coverage import unmonitored as unmonitored
from executive.safety.evidence import Evidence as Evidence
from executive.safety.motion_history import MotionHistory as MotionHistory
from executive.safety.motion_history import OdometryWindow as OdometryWindow
from executive.safety.pose_uncertainty import PoseMonitor as PoseMonitor
from executive.safety.pose_uncertainty import StoredPose as StoredPose
from executive.safety.safety import HOLDING_REACTIONS as HOLDING_REACTIONS
from executive.safety.safety import MONITORS as MONITORS
from executive.safety.safety import Fault as Fault
from executive.safety.safety import FaultMonitor as FaultMonitor
from executive.safety.twist_delay import TWIST_KINDS as TWIST_KINDS
