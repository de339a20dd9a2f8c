"""State of the rover: status, telemetry, files and pictures."""

from executive.state.files import MAX_PATH_OCTETS as MAX_PATH_OCTETS
from executive.state.files import FileFolder as FileFolder
from executive.state.files import FileStamp as FileStamp
from executive.state.files import check_path as check_path
from executive.state.files import picture_of as picture_of
from executive.state.files import store_picture as store_picture
from executive.state.fusion import FramePair as FramePair
from executive.state.fusion import PoseDisagreement as PoseDisagreement
from executive.state.fusion import disagreement as disagreement
from executive.state.motion_statistics import MotionStatistics as MotionStatistics
from executive.state.navigation import NavigationTrack as NavigationTrack
from executive.state.standstill import FRAME_DISTANCE_M as FRAME_DISTANCE_M
from executive.state.standstill import SourceMotion as SourceMotion
from executive.state.standstill import is_slow as is_slow
from executive.state.standstill import join_sources as join_sources
from executive.state.status import Rejections as Rejections
from executive.state.status import Status as Status
from executive.state.status import Telemetry as Telemetry
from executive.state.uncertainty import PROMISED_M as PROMISED_M
from executive.state.uncertainty import PROMISED_RAD as PROMISED_RAD
from executive.state.uncertainty import PROMISED_RATIO as PROMISED_RATIO
from executive.state.uncertainty import RECOVERY as RECOVERY
from executive.state.uncertainty import Uncertainty as Uncertainty
