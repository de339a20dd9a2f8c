"""Makes messages of Foxglove's well-known JSON schemas, which viewers of recordings display.

https://docs.foxglove.dev/docs/visualization/message-schemas
"""

import base64
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from executive.values.geometry import Point, Pose
from executive.values.reports import Severity

Plain = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Schema:
    """Type of messages.

    Attributes:
        name: name of the schema, for viewers if it is one of Foxglove's.
    """

    name: str
    json: Plain


def object_of(**properties: Plain) -> Plain:
    """Return the JSON schema of an object."""
    return {"type": "object", "properties": properties}


def array_of(items: Plain) -> Plain:
    """Return the JSON schema of an array."""
    return {"type": "array", "items": items}


NUMBER: Final[Plain] = {"type": "number"}
TEXT: Final[Plain] = {"type": "string"}
_INTEGER: Final[Plain] = {"type": "integer"}
_BOOLEAN: Final[Plain] = {"type": "boolean"}
_OCTETS: Final[Plain] = {"type": "string", "contentEncoding": "base64"}
_TIME: Final[Plain] = {"title": "time", **object_of(sec=_INTEGER, nsec=_INTEGER)}
_DURATION: Final[Plain] = {"title": "duration", **object_of(sec=_INTEGER, nsec=_INTEGER)}
_VECTOR: Final = object_of(x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION: Final = object_of(x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE: Final = object_of(position=_VECTOR, orientation=_QUATERNION)
_COLOR: Final = object_of(r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_CUBE: Final = object_of(pose=_POSE, size=_VECTOR, color=_COLOR)
_CYLINDER: Final = object_of(
    pose=_POSE, size=_VECTOR, color=_COLOR, bottom_scale=NUMBER, top_scale=NUMBER
)
_LINE: Final = object_of(
    type=_INTEGER,
    pose=_POSE,
    thickness=NUMBER,
    scale_invariant=_BOOLEAN,
    points=array_of(_VECTOR),
    color=_COLOR,
    colors=array_of(_COLOR),
    indices=array_of(_INTEGER),
)
_NONE: Final = array_of(object_of())
_KINDS: Final = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
_ENTITY: Final = object_of(
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_DURATION,
    frame_locked=_BOOLEAN,
    metadata=_NONE,
    **dict.fromkeys(_KINDS, _NONE)
    | {"cubes": array_of(_CUBE), "cylinders": array_of(_CYLINDER), "lines": array_of(_LINE)},
)
_DELETION: Final = object_of(timestamp=_TIME, type=_INTEGER, id=TEXT)

FRAME_TRANSFORM: Final = Schema(
    "foxglove.FrameTransform",
    object_of(
        timestamp=_TIME,
        parent_frame_id=TEXT,
        child_frame_id=TEXT,
        translation=_VECTOR,
        rotation=_QUATERNION,
    ),
)
POSE_IN_FRAME: Final = Schema(
    "foxglove.PoseInFrame", object_of(timestamp=_TIME, frame_id=TEXT, pose=_POSE)
)
LOG: Final = Schema(
    "foxglove.Log",
    object_of(timestamp=_TIME, level=_INTEGER, message=TEXT, name=TEXT, file=TEXT, line=_INTEGER),
)
COMPRESSED_IMAGE: Final = Schema(
    "foxglove.CompressedImage", object_of(timestamp=_TIME, frame_id=TEXT, data=_OCTETS, format=TEXT)
)
LASER_SCAN: Final = Schema(
    "foxglove.LaserScan",
    object_of(
        timestamp=_TIME,
        frame_id=TEXT,
        pose=_POSE,
        start_angle=NUMBER,
        end_angle=NUMBER,
        ranges=array_of(NUMBER),
        intensities=array_of(NUMBER),
    ),
)
SCENE_UPDATE: Final = Schema(
    "foxglove.SceneUpdate", object_of(deletions=array_of(_DELETION), entities=array_of(_ENTITY))
)

LEVELS: Final[Mapping[Severity, int]] = {
    Severity.INFORMATIONAL: 2,
    Severity.WARNING: 3,
    Severity.ALARM: 4,
    Severity.SEVERE: 4,
    Severity.CRITICAL: 5,
}
_FINE: Final = 4
"""Decimal digits: for display, a tenth of a millimetre is enough."""
_MATCHING_ALL: Final = 1
_LINE_STRIP: Final = 0


def time_of(utc_s: float) -> Plain:
    """Return a Foxglove time, to the microsecond, from seconds since 1970-01-01 UTC."""
    microseconds = round(utc_s * 1e6)
    return {"sec": microseconds // 10**6, "nsec": microseconds % 10**6 * 1000}


def fine(value: float) -> float:
    """Return a figure rounded for display."""
    return round(value, _FINE)


def _vector(x_m: float, y_m: float, z_m: float = 0.0) -> Plain:
    return {"x": fine(x_m), "y": fine(y_m), "z": fine(z_m)}


def _quaternion(pose: Pose) -> Plain:
    return {name: fine(part) for name, part in zip("xyzw", pose.quaternion, strict=True)}


def _pose(pose: Pose) -> Plain:
    return {"position": _vector(pose.x_m, pose.y_m, pose.z_m), "orientation": _quaternion(pose)}


def frame_transform(utc_s: float, parent: str, child: str, pose: Pose) -> Plain:
    """Return the pose of a child frame in its parent."""
    return {
        "timestamp": time_of(utc_s),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": _vector(pose.x_m, pose.y_m, pose.z_m),
        "rotation": _quaternion(pose),
    }


def pose_in_frame(utc_s: float, frame: str, pose: Pose) -> Plain:
    """Return a pose in a frame."""
    return {"timestamp": time_of(utc_s), "frame_id": frame, "pose": _pose(pose)}


def log(utc_s: float, severity: Severity, text: str, name: str) -> Plain:
    """Return a log line; the name is its subject."""
    level = LEVELS[severity]
    timestamp = time_of(utc_s)
    line = {"level": level, "message": text, "name": name, "file": "", "line": 0}
    return {"timestamp": timestamp, **line}


def compressed_image(utc_s: float, frame: str, jpeg: bytes) -> Plain:
    """Return a JPEG picture."""
    data = base64.b64encode(jpeg).decode()
    return {"timestamp": time_of(utc_s), "frame_id": frame, "data": data, "format": "jpeg"}


def laser_scan(
    utc_s: float, frame: str, start_rad: float, end_rad: float, ranges_m: Iterable[float]
) -> Plain:
    """Return a scan in the plane of a frame, about its origin."""
    return {
        "timestamp": time_of(utc_s),
        "frame_id": frame,
        "pose": _pose(Pose()),
        "start_angle": fine(start_rad),
        "end_angle": fine(end_rad),
        "ranges": list(ranges_m),
        "intensities": [],
    }


@dataclass(frozen=True, slots=True)
class Color:
    """Colour: red, green, blue and opacity, each 0 to 1."""

    r: float
    g: float
    b: float
    a: float = 1.0


def line(points: Iterable[Point], color: Color, width_m: float = 0.03) -> Plain:
    """Return a polyline in the plane, for `entity`."""
    return {
        "type": _LINE_STRIP,
        "pose": _pose(Pose()),
        "thickness": width_m,
        "scale_invariant": False,
        "points": [_vector(point.x_m, point.y_m) for point in points],
        "color": asdict(color),
        "colors": [],
        "indices": [],
    }


def cube(pose: Pose, size_m: tuple[float, float, float], color: Color) -> Plain:
    """Return a cuboid about a pose, with its size along its axes, for `entity`."""
    return {"pose": _pose(pose), "size": _vector(*size_m), "color": asdict(color)}


def cylinder(pose: Pose, radius_m: float, height_m: float, color: Color) -> Plain:
    """Return an upright cylinder about a pose, for `entity`."""
    solid = cube(pose, (2 * radius_m, 2 * radius_m, height_m), color)
    return solid | {"bottom_scale": 1.0, "top_scale": 1.0}


def entity(
    utc_s: float,
    frame: str,
    name: str,
    *,
    lines: Iterable[Plain] = (),
    cubes: Iterable[Plain] = (),
    cylinders: Iterable[Plain] = (),
) -> Plain:
    """Return a scene entity that moves with a frame; a later one with its name replaces it."""
    parts: Plain = {kind: [] for kind in _KINDS}
    parts |= {"lines": list(lines), "cubes": list(cubes), "cylinders": list(cylinders)}
    return {
        "timestamp": time_of(utc_s),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **parts,
    }


def scene(utc_s: float, *entities: Plain) -> Plain:
    """Return a scene update that replaces the earlier content of its topic."""
    everything = {"timestamp": time_of(utc_s), "type": _MATCHING_ALL, "id": ""}
    return {"deletions": [] if entities else [everything], "entities": list(entities)}
