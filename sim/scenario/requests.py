"""What a file asks of the rover: an operation and its arguments into a request."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from executive.commands import (
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
    PlanArgument,
    PlanDefinition,
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
    Waypoint,
)
from executive.plans import FORMAT
from executive.settings import config_folder
from sim.scenario.strict import FormatError, StrictReader

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


SUFFIX: Final = ".xml"


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanFile:
    """A plan to submit.

    Attributes:
        plan: a name in config/plans, or an XML file beside the scenario.
        id: under which it is submitted; None is the file's name.
    """

    plan: str
    id: str | None = None
    arguments: tuple[PlanArgument, ...] = ()


def read_request(raw: Any, path: str, folder: Path) -> Request:
    """Return what a file asks of the rover.

    Args:
        raw: the name of an operation, or that name with arguments.
        path: of the key, for errors.
        folder: where the scenario lies.

    Raises:
        FormatError: there is no such operation, or its arguments do not fit.
    """
    alone = isinstance(raw, dict) and len(raw) == 1
    name, arguments = next(iter(raw.items())) if alone else (raw, {})
    kind = OPERATIONS.get(name) if isinstance(name, str) else None
    if kind is None:
        raise FormatError(path, f"{name!r} is no operation; known are {', '.join(OPERATIONS)}")
    reader, inner = StrictReader({}), f"{path}.{name}"
    if kind is MoveTo:
        return MoveTo(reader.read(arguments, Waypoint, inner))
    if kind is SubmitPlan:
        return SubmitPlan(_plan(reader.read(arguments, PlanFile, inner), f"{inner}.plan", folder))
    return reader.read(arguments, kind, inner)


def _plan(said: PlanFile, path: str, folder: Path) -> PlanDefinition:
    beside = said.plan.endswith(SUFFIX)
    file = folder / said.plan if beside else config_folder() / "plans" / f"{said.plan}{SUFFIX}"
    try:
        content = file.read_bytes()
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise FormatError(path, f"{said.plan!r} cannot be read ({why})") from error
    return PlanDefinition(said.id or file.stem, file.name, FORMAT, content, said.arguments)
