"""What the rover is about, and which commands are accepted then: one table."""

from enum import Enum, unique
from typing import Final, assert_never

from executive.commands.catalogue import (
    AbortPlan,
    ActivatePlan,
    DeleteFile,
    DriveFor,
    ExecuteAction,
    FollowPath,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    MoveTo,
    RemovePlan,
    Request,
    Resume,
    ResumePlan,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    SubmitPlan,
    SuspendPlan,
    TakePicture,
)


@unique
class Mode(Enum):
    """The asset's mode (numbers as on the MRS wire)."""

    IDLE = 1
    MOVING = 2
    TELEOP = 3
    PLAN = 4
    PAUSED = 5
    STOPPED = 6
    SAFE = 7


@unique
class Family(Enum):
    """Commands that are accepted in the same modes."""

    MOTION = "motion"
    CAMERA = "camera"
    ERRAND = "file, action"
    POSE = "pose compensation"
    SETTING = "setting"
    PLAN = "plan"
    PLAN_START = "plan: activate, resume"
    STOP = "stop"
    RESUME = "resume"


ACCEPTED: Final = {
    Family.MOTION: {Mode.IDLE, Mode.MOVING, Mode.TELEOP, Mode.PAUSED},
    Family.CAMERA: set(Mode),
    Family.ERRAND: set(Mode),
    Family.POSE: {Mode.IDLE, Mode.PAUSED, Mode.STOPPED, Mode.SAFE},
    Family.SETTING: set(Mode),
    Family.PLAN: set(Mode),
    Family.PLAN_START: {Mode.IDLE, Mode.PLAN, Mode.PAUSED},
    Family.STOP: set(Mode),
    Family.RESUME: {Mode.STOPPED, Mode.SAFE},
}


def family(request: Request) -> Family:
    """Return the family of a request."""
    match request:
        case MoveTo() | MoveForward() | RotateTo() | RotateBy() | DriveFor() | FollowPath():
            return Family.MOTION
        case SetCameraAngles() | MoveCameraAngles() | TakePicture():
            return Family.CAMERA
        case DeleteFile() | MoveFile() | ExecuteAction():
            return Family.ERRAND
        case SetPositionCompensation():
            return Family.POSE
        case SetTravelSpeed() | SetRotateSpeed() | SetCameraRotateSpeed() | SetStatusInterval():
            return Family.SETTING
        case SubmitPlan() | SuspendPlan() | AbortPlan() | RemovePlan():
            return Family.PLAN
        case ActivatePlan() | ResumePlan():
            return Family.PLAN_START
        case Stop():
            return Family.STOP
        case Resume():
            return Family.RESUME
        case _:
            assert_never(request)


def advice(mode: Mode, request: Request) -> str:
    """Return what to do about a command that the mode does not accept."""
    accepted = ", ".join(sorted(m.name for m in ACCEPTED[family(request)]))
    return f"the rover is {mode.name}, this needs {accepted}{_WAY_OUT.get(mode, '')}"


_WAY_OUT: Final = {
    Mode.STOPPED: "; send resume first",
    Mode.SAFE: "; send resume first",
    Mode.PLAN: "; suspend the plan first",
}
