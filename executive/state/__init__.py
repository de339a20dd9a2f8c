"""What the rover knows: status, telemetry, files and pictures."""

from executive.state.files import (
    LONGEST_PATH,
    FileFolder,
    FileStamp,
    check_path,
    store_picture,
)
from executive.state.fusion import Disagreement, FramePair, disagreement
from executive.state.motion_statistics import MotionStatistics
from executive.state.rejections import Rejections
from executive.state.standstill import FRAME_WAY_M, SourceMotion, is_slow, listed
from executive.state.status import Status
from executive.state.telemetry import Telemetry
from executive.state.uncertainty import (
    PROMISED_M,
    PROMISED_RAD,
    PROMISED_RATIO,
    Uncertainty,
)

__all__ = [
    "FRAME_WAY_M",
    "LONGEST_PATH",
    "PROMISED_M",
    "PROMISED_RAD",
    "PROMISED_RATIO",
    "Disagreement",
    "FileFolder",
    "FileStamp",
    "FramePair",
    "MotionStatistics",
    "Rejections",
    "SourceMotion",
    "Status",
    "Telemetry",
    "Uncertainty",
    "check_path",
    "disagreement",
    "is_slow",
    "listed",
    "store_picture",
]
