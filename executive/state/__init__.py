"""What the rover knows: facts, status, parameters, telemetry, files and pictures."""

from executive.state.facts import (
    VELOCITY_TOPIC,
    AuthorityUsed,
    Battery,
    CameraAngles,
    CommandEnded,
    CommandUnderWay,
    Fact,
    ForeignPublishers,
    Frame,
    Imu,
    Joints,
    LaserScan,
    MotionEnded,
    MotionStarted,
    Odometry,
    OtherInput,
    SecondOdometry,
    Stopped,
)
from executive.state.files import (
    LONGEST_PATH,
    FileEvent,
    FileEventKind,
    FileFolder,
    FileStamp,
    check_path,
    store_picture,
)
from executive.state.fusion import FramePair, disagreement
from executive.state.local_map import directions_of
from executive.state.standstill import SourceMotion, is_slow, listed
from executive.state.status import Status
from executive.state.telemetry import Parameter, ParameterValue, Telemetry
from executive.state.uncertainty import (
    PROMISED_M,
    PROMISED_RAD,
    PROMISED_RATIO,
    Uncertainty,
)

__all__ = [
    "LONGEST_PATH",
    "PROMISED_M",
    "PROMISED_RAD",
    "PROMISED_RATIO",
    "VELOCITY_TOPIC",
    "AuthorityUsed",
    "Battery",
    "CameraAngles",
    "CommandEnded",
    "CommandUnderWay",
    "Fact",
    "FileEvent",
    "FileEventKind",
    "FileFolder",
    "FileStamp",
    "ForeignPublishers",
    "Frame",
    "FramePair",
    "Imu",
    "Joints",
    "LaserScan",
    "MotionEnded",
    "MotionStarted",
    "Odometry",
    "OtherInput",
    "Parameter",
    "ParameterValue",
    "SecondOdometry",
    "SourceMotion",
    "Status",
    "Stopped",
    "Telemetry",
    "Uncertainty",
    "check_path",
    "directions_of",
    "disagreement",
    "is_slow",
    "listed",
    "store_picture",
]
