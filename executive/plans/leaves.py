"""The leaves of plans: one row an MRS operation, with its parameters and the request it makes."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
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
    RotateBy,
    RotateTo,
    SetCameraAngles,
    SetCameraRotateSpeed,
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
    TakePicture,
    Waypoint,
)


@unique
class Kind(Enum):
    """What the text of an attribute holds, and what it is called where people write plans."""

    NUMBER = "double"
    COUNT = "int"
    TEXT = "std::string"
    PLACES = "std::vector<Place>"


@dataclass(frozen=True, slots=True)
class Parameter:
    """One attribute of a leaf, named as in the MRS."""

    name: str
    help: str
    kind: Kind = Kind.NUMBER
    required: bool = True


@dataclass(frozen=True, slots=True)
class Leaf:
    """A leaf that people may write.

    Attributes:
        operation: the MRS operation, with its service.
        make: makes the request from the values of the parameters, in their order; None for those
            that were not given.
    """

    name: str
    operation: str
    parameters: tuple[Parameter, ...]
    make: Callable[..., Request]


DEADLINE: Final = Parameter(
    "deadline_s",
    "seconds after which it fails; needed unless a Timeout stands above",
    required=False,
)

_SPEED_M: Final = Parameter("speed", "m/s")
_SPEED_RAD: Final = Parameter("speed", "rad/s")
_PATH: Final = Parameter("path", "file, relative to the monitored folder", Kind.TEXT)


LEAVES: Final = {
    leaf.name: leaf
    for leaf in (
        Leaf(
            "moveTo",
            "MotionControl.moveTo",
            (
                Parameter("x", "m, odometry frame"),
                Parameter("y", "m, odometry frame"),
                Parameter("heading", "rad, to take at the end", required=False),
                Parameter("tolerance", "m, how near is near enough", required=False),
            ),
            lambda x, y, heading, tolerance: MoveTo(Waypoint(x, y, heading, tolerance)),
        ),
        Leaf(
            "moveForward",
            "MotionControl.moveForward",
            (Parameter("distance", "m, negative is backward"),),
            MoveForward,
        ),
        Leaf(
            "rotateTo",
            "MotionControl.rotateTo",
            (Parameter("heading", "rad, absolute"),),
            RotateTo,
        ),
        Leaf(
            "rotateBy",
            "MotionControl.rotateBy",
            (Parameter("angle", "rad, counter-clockwise positive"),),
            RotateBy,
        ),
        Leaf(
            "drive",
            "MotionControl.drive",
            (
                Parameter("travel", "m/s"),
                Parameter("rotate", "rad/s"),
                Parameter("duration", "s"),
            ),
            DriveFor,
        ),
        Leaf(
            "followPath",
            "MotionControl.followPath",
            (Parameter("waypoints", "x,y or x,y,heading (m, rad) joined by ;", Kind.PLACES),),
            FollowPath,
        ),
        Leaf("setTravelSpeed", "MotionControl.setTravelSpeed", (_SPEED_M,), SetTravelSpeed),
        Leaf("setRotateSpeed", "MotionControl.setRotateSpeed", (_SPEED_RAD,), SetRotateSpeed),
        Leaf(
            "setPositionCompensation",
            "MotionControl.setPositionCompensation",
            (
                Parameter("x", "m"),
                Parameter("y", "m"),
                Parameter("z", "m"),
                Parameter("heading", "rad"),
            ),
            SetPositionCompensation,
        ),
        Leaf(
            "takePicture",
            "Camera.takePicture",
            (
                Parameter("width", "pixel", Kind.COUNT, required=False),
                Parameter("height", "pixel", Kind.COUNT, required=False),
                Parameter("format", "JPG, PNG or RAW", Kind.TEXT, required=False),
                Parameter("quality", "1 to 100", Kind.COUNT, required=False),
            ),
            TakePicture,
        ),
        Leaf(
            "setCameraAngles",
            "Camera.setAngles",
            (
                Parameter("pan", "rad", required=False),
                Parameter("tilt", "rad", required=False),
            ),
            SetCameraAngles,
        ),
        Leaf(
            "moveCameraAngles",
            "Camera.moveAngles",
            (Parameter("pan", "rad, relative"), Parameter("tilt", "rad, relative")),
            MoveCameraAngles,
        ),
        Leaf("setCameraRotateSpeed", "Camera.setRotateSpeed", (_SPEED_RAD,), SetCameraRotateSpeed),
        Leaf(
            "setStatusInterval",
            "Status.setStatusInterval",
            (Parameter("interval", "s, 0 on change only"),),
            SetStatusInterval,
        ),
        Leaf("deleteFile", "FileManagement.delete", (_PATH,), DeleteFile),
        Leaf(
            "moveFile",
            "FileManagement.move",
            (_PATH, Parameter("target", "where nothing lies yet", Kind.TEXT)),
            MoveFile,
        ),
        Leaf(
            "executeAction",
            "Action.execute",
            (Parameter("action", "one line of text, as VIDEO ON", Kind.TEXT),),
            ExecuteAction,
        ),
    )
}
"""Named after the MRS operation, and as in `rover command` and in scenarios: two services have a
`setRotateSpeed`, so that the camera's operations say Camera; those on files and actions say so."""
