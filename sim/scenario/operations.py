"""The operations that a scenario can call: those of the MRS that carry a command.

Two services of the MRS have a `setRotateSpeed`, so that the camera's operations say Camera here.
"""

from collections.abc import Mapping
from typing import Final

from executive.commands import (
    DeleteFile,
    DriveFor,
    ExecuteAction,
    FollowPath,
    MoveCameraAngles,
    MoveFile,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    Stop,
    TakePicture,
)
from executive.plans.requests import (
    AbortPlan,
    ActivatePlan,
    RemovePlan,
    ResumePlan,
    SubmitPlan,
    SuspendPlan,
)

OPERATIONS: Final[Mapping[str, type[Request]]] = {
    "moveTo": MoveTo,
    "moveForward": MoveForward,
    "rotateTo": RotateTo,
    "rotateBy": RotateBy,
    "drive": DriveFor,
    "followPath": FollowPath,
    "stop": Stop,
    "resume": Resume,
    "setTravelSpeed": SetTravelSpeed,
    "setRotateSpeed": SetRotateSpeed,
    "setPositionCompensation": SetPositionCompensation,
    "setCameraAngles": SetCameraAngles,
    "moveCameraAngles": MoveCameraAngles,
    "setCameraRotateSpeed": SetCameraRotateSpeed,
    "takePicture": TakePicture,
    "setStatusInterval": SetStatusInterval,
    "deleteFile": DeleteFile,
    "moveFile": MoveFile,
    "executeAction": ExecuteAction,
    "submitPlan": SubmitPlan,
    "activatePlan": ActivatePlan,
    "suspendPlan": SuspendPlan,
    "resumePlan": ResumePlan,
    "abortPlan": AbortPlan,
    "removePlan": RemovePlan,
}

_NAMES: Final = {kind: name for name, kind in OPERATIONS.items()}


def operation_of(request: Request) -> str:
    """Return the name of the operation that carries a request."""
    return _NAMES[type(request)]
