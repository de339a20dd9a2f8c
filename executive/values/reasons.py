"""Numbered reasons for rejecting or failing a command, in blocks of a hundred.

A refusal is a value, never an exception: it carries the measured figure and its bound.
"""

from dataclasses import dataclass
from enum import Enum, unique
from typing import Final, Self

from executive.values.quantities import quantity_text


@unique
class Reason(Enum):
    """Reason for a rejection or failure. The number travels as `Notification.code`."""

    NOT_FINITE = 101
    OUT_OF_RANGE = 102
    EMPTY_PATH = 103
    BAD_IDENTIFIER = 104
    BAD_PATH = 105

    PLAN_FORMAT = 111
    PLAN_TOO_LARGE = 112
    PLAN_NOT_XML = 113
    PLAN_STRUCTURE = 114
    PLAN_UNKNOWN_NODE = 115
    PLAN_BAD_ARGUMENT = 116
    PLAN_NO_DEADLINE = 117
    NO_SUCH_OPTION = 118

    WRONG_MODE = 201
    EXPIRED = 202
    NO_ODOMETRY = 203
    CAUSE_PERSISTS = 204
    TARGET_EXISTS = 205
    PLAN_STATUS = 206
    PLAN_ACTIVE = 207
    PLAN_EXISTS = 208
    NO_AUTHORITY = 209
    CREATED_IN_FUTURE = 210
    PATH_BLOCKED = 211
    BATTERY_INSUFFICIENT = 212
    POSE_UNCERTAIN = 213
    TURN_TOO_TIGHT = 214
    NO_MAP = 215
    OPERATOR_ACTIVE = 216
    QUESTION_ANSWERED = 217
    PRECONDITION_POSE = 218
    PRECONDITION_COMMAND = 219
    PRECONDITION_MODE = 220

    DUPLICATE = 301

    NOT_SUPPORTED = 401
    UNKNOWN_ACTION = 402

    QUEUE_FULL = 501
    TOO_MANY_PLANS = 502

    NO_SUCH_FILE = 601
    NO_SUCH_PLAN = 602
    NO_SUCH_STEP = 603
    NO_SUCH_QUESTION = 604

    TURN_DEADLINE = 701
    DRIVE_DEADLINE = 711
    OFF_TARGET = 712
    MOTION_NOT_EXECUTED = 713
    UNVERIFIED = 714
    NOT_CONFIRMED = 715
    STOP_DEADLINE = 721
    PAN_TILT_DEADLINE = 731
    CAPTURE_DEADLINE = 741
    CAPTURE_NOT_STORED = 742
    CAPTURE_STALE = 743
    CAPTURE_TRUNCATED = 744
    INSTANT_COMMAND_FAILED = 751
    PLAN_DEADLINE = 761
    PLAN_FAILED = 762
    NAVIGATION_UNAVAILABLE = 771
    NAVIGATION_REJECTED = 772
    NAVIGATION_FAILED = 773
    NAVIGATION_TIMEOUT = 774
    NAVIGATION_PREEMPTED = 775
    NAVIGATION_UNCOMMANDED_MOTION = 776

    STOPPED = 801
    REPLACED = 802
    INTERRUPTED = 803
    PLAN_SUSPENDED = 804
    STEP_HALTED = 805
    PLAN_ABORTED = 806
    CANCELLED_BY_CLIENT = 807

    LEAF_RAISED = 901
    ODOMETRY_STALE = 902
    ODOMETRY_JUMPED = 903
    TILT_LIMIT = 904
    BATTERY_LOW = 905
    LEDGER_FAILED = 906
    ADAPTER_RAISED = 907
    CORE_HUNG = 908
    TICK_LATE = 910

    WHEELS_OFF_COMMAND = 941
    WHEELS_UNPOWERED = 942
    ODOMETRY_OFF_WHEELS = 943
    ODOMETRY_OFF_GYRO = 944
    WHEELS_OFF_GYRO = 945
    WHEEL_SLIP = 946
    MOTION_BLOCKED = 947
    TRAVEL_SLIP = 951
    TURN_SLIP = 952
    SLIDE_AT_REST = 953
    SENSOR_SILENT = 961
    DATA_REJECTED = 962
    FAULT_CLEARED = 909
    OTHER_PUBLISHER = 930
    LINK_LOST = 931
    ZONE_AHEAD = 971
    OBSTACLE_AHEAD = 972
    OBSTACLE_NEAR = 973
    LASER_SILENT = 974
    LASER_BLIND = 975
    ODOMETRY_NOT_FINITE = 911
    ODOMETRY_LATE = 912
    ODOMETRY_RATE_LOW = 913
    ODOMETRY_SILENT = 914
    ODOMETRY_FROZEN = 915
    ODOMETRY_INCONSISTENT = 916
    OFF_COMMAND = 917
    UNCOMMANDED_MOTION = 918
    NO_PROGRESS = 919
    BATTERY_SILENT = 921
    BATTERY_NOT_FINITE = 922
    EMERGENCY_STOP = 923


@dataclass(frozen=True, slots=True)
class UnknownReason:
    """A reason number of a newer rover that this version does not declare."""

    value: int

    @property
    def name(self) -> str:
        """A text in place of the name."""
        return "unknown here"


PREDICTED: Final = "predicted "
"""Prefix of the names of predicted figures; the remainder is the name of the quantity."""


@dataclass(frozen=True, slots=True)
class Figure:
    """A named number of a report: a requested, measured or permitted value.

    Attributes:
        unit: for display (m, rad, m/s, s, V), empty for a count.
    """

    name: str
    value: float
    unit: str = ""

    def __str__(self) -> str:
        return f"{self.name} {quantity_text(self.value, self.unit)}"


@dataclass(frozen=True, slots=True)
class Identity:
    """Command id: source and number, the key of deduplication."""

    source: str
    command_id: int

    def __str__(self) -> str:
        return f"{self.source}:{self.command_id}"

    @classmethod
    def parse(cls, text: str) -> Self | None:
        """Return the command id of its text; None if it is none."""
        source, _, number = text.rpartition(":")
        return cls(source, int(number)) if source and number.isdecimal() else None


@dataclass(frozen=True, slots=True)
class Refusal:
    """A numbered reason with one sentence for the operator and its figures.

    Attributes:
        argument: index of the offending argument of the operation, if any.
        subject: name of the object that was not found.
        fault: name of the fault that causes it, if any.
        cause: the other command that causes it, if any.
    """

    reason: Reason
    text: str
    figures: tuple[Figure, ...] = ()
    argument: int | None = None
    subject: str = ""
    fault: str | None = None
    cause: Identity | None = None
