"""`ViewBuilder` adds to a recording what viewers such as Foxglove show; nothing here reads it.

Topics use Foxglove's well-known schemas if there is one; numbers to plot, the mode and the
tree have plain ones. Figures are rounded; most topics are limited to ten messages a second.
"""

import io
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from typing import Final

from adapters.recording.foxglove import (
    COMPRESSED_IMAGE,
    FRAME_TRANSFORM,
    LASER_SCAN,
    LOG,
    NUMBER,
    POSE_IN_FRAME,
    SCENE_UPDATE,
    TEXT,
    Color,
    Plain,
    Schema,
    array_of,
    compressed_image,
    cube,
    cylinder,
    entity,
    fine,
    frame_transform,
    laser_scan,
    line,
    log,
    object_of,
    pose_in_frame,
    scene,
)
from executive.commands import FollowPath, Line, Motion, MoveTo
from executive.commands.intake import in_map
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    FactObserved,
    Item,
    ModeChanged,
    PathRequested,
    ProcessStart,
    ReportSent,
    TelemetrySent,
    TreeChanged,
    TreeNodeState,
    Truth,
    VelocityCommanded,
)
from executive.obstacles.zones import KeepIn, KeepOut, KnownRock
from executive.settings import Settings
from executive.values.facts import (
    Battery,
    CameraAngles,
    Fact,
    Frame,
    Imu,
    Joints,
    LaserScan,
    MapToOdom,
    NavigationFeedback,
    NavigationStatus,
    Odometry,
    PlannedPath,
    SecondOdometry,
)
from executive.values.geometry import Point, Pose, TargetFrame
from executive.values.parameters import Parameter
from executive.values.ports import PathRequest
from executive.values.reports import Identity, Report, Stage

ODOM: Final = "odom"
BASE_LINK: Final = "base_link"
CAMERA: Final = "camera"

FAST_PERIOD_S: Final = 0.1
SLOW_PERIOD_S: Final = 0.5
RARE_PERIOD_S: Final = 1.0
TRACK_S: Final = 3.0
"""Minimum periods between two messages of a topic."""

_TRACK_M: Final = 0.2
_MAX_TRACK_POINTS: Final = 200
_THUMBNAIL_PX: Final = (160, 120)
_HEIGHT_M: Final = 0.3
_GREEN, _RED = Color(0.2, 0.7, 0.3), Color(0.85, 0.2, 0.2)
_BLUE, _GREY = Color(0.1, 0.45, 0.9), Color(0.5, 0.5, 0.5, 0.8)

_VELOCITY: Final = object_of(travel_mps=NUMBER, rotate_radps=NUMBER)
_MOTION: Final = Schema(
    "rover.Motion",
    object_of(
        commanded=_VELOCITY,
        odometry=object_of(
            travel_mps=NUMBER, rotate_radps=NUMBER, x_m=NUMBER, y_m=NUMBER, heading_rad=NUMBER
        ),
        wheels=object_of(left_radps=NUMBER, right_radps=NUMBER, left_nm=NUMBER, right_nm=NUMBER),
        imu=object_of(
            roll_rad=NUMBER,
            pitch_rad=NUMBER,
            rotate_radps=NUMBER,
            forward_mps2=NUMBER,
            left_mps2=NUMBER,
            up_mps2=NUMBER,
        ),
        battery=object_of(voltage_v=NUMBER, charge_ratio=NUMBER),
        camera=object_of(pan_rad=NUMBER, tilt_rad=NUMBER),
    ),
)
_NAVIGATION: Final = Schema(
    "rover.Navigation",
    object_of(goal=NUMBER, state=TEXT, text=TEXT, remaining_m=NUMBER, recoveries=NUMBER),
)
_MODE: Final = Schema("rover.Mode", object_of(mode=TEXT, command=TEXT, why=TEXT))
_TREE: Final = Schema(
    "rover.Tree", object_of(nodes=array_of(object_of(path=TEXT, status=TEXT, message=TEXT)))
)
_PARAMETERS: Final = Schema(
    "rover.Parameters", object_of(**{each.name: NUMBER for each in Parameter})
)

TOPICS: Final[Mapping[str, Schema]] = {
    "/tf": FRAME_TRANSFORM,
    "/pose/second_odometry": POSE_IN_FRAME,
    "/pose/truth": POSE_IN_FRAME,
    "/scene/rover": SCENE_UPDATE,
    "/scene/zones": SCENE_UPDATE,
    "/scene/track": SCENE_UPDATE,
    "/scene/goal": SCENE_UPDATE,
    "/scan": LASER_SCAN,
    "/camera": COMPRESSED_IMAGE,
    "/log": LOG,
    "/motion": _MOTION,
    "/navigation": _NAVIGATION,
    "/parameters": _PARAMETERS,
    "/mode": _MODE,
    "/tree": _TREE,
}
"""All topics of the view."""


@dataclass(frozen=True, slots=True)
class ViewMessage:
    """A message of a topic of the view."""

    topic: str
    message: Plain


class ViewBuilder:
    """Derives the view's messages from the items of a recording, in order."""

    def __init__(self) -> None:
        self._utc_s = 0.0
        self._due_s: dict[str, float] = {}
        self._begin(None)

    def _begin(self, settings: Settings | None) -> None:
        self._settings = settings
        self._still_shown = False
        self._motion: Plain = {}
        self._pose = self._map_origin = Pose()
        self._track = _Track()
        self._nodes: dict[str, TreeNodeState] = {}
        self._tree_changed = False
        self._mode: Plain = {}
        self._requests: dict[Identity, Motion] = {}
        self._aim: Identity | None = None
        self._navigation: Plain = {}
        self._path_request: PathRequest | None = None

    def restart_file(self) -> None:
        """Prepare for another file, which must contain the unchanged content, too."""
        self._still_shown = False
        self._tree_changed = True

    def of(self, item: Item) -> Iterator[ViewMessage]:
        """Yield the messages that an item causes."""
        match item:
            case ProcessStart(settings=settings):
                self._begin(settings)
            case CoreCalled(utc_s=utc_s, call=call):
                self._utc_s = utc_s
                yield from self._at_call(call)
            case FactObserved(utc_s=utc_s, fact=fact):
                self._utc_s = utc_s
                yield from self._of_fact(fact)
            case VelocityCommanded(velocity=velocity):
                self._motion["commanded"] = _velocity(velocity.travel_mps, velocity.rotate_radps)
            case CommandDequeued(command=command):
                if isinstance(command.request, Motion):
                    self._requests[command.identity] = command.request
            case PathRequested(request=request):
                self._path_request = request
            case ReportSent(report=report):
                yield from self._of_report(report)
            case TelemetrySent(values=values):
                known = ((each.parameter.name, each.value) for each in values)
                yield ViewMessage("/parameters", _known(known))
            case ModeChanged(mode=mode, active=active, why=why):
                prefix = "" if active is None else str(active)
                self._mode = {"mode": mode.name, "command": prefix, "why": why}
                yield ViewMessage("/mode", self._mode)
            case TreeChanged(nodes=nodes, removed=removed):
                self._nodes |= {each.path: each for each in nodes}
                for path in removed:
                    self._nodes.pop(path, None)
                self._tree_changed = True
            case Truth(pose=pose):
                if self._due("/pose/truth", SLOW_PERIOD_S):
                    yield ViewMessage("/pose/truth", pose_in_frame(self._utc_s, ODOM, pose))
            case _:
                pass

    def _due(self, topic: str, period_s: float) -> bool:
        """Return whether a message is due; if so, count it as sent."""
        if self._utc_s < self._due_s.get(topic, 0.0):
            return False
        self._due_s[topic] = self._utc_s + period_s - 1e-3
        return True

    def _at_call(self, call: CoreCall) -> Iterator[ViewMessage]:
        if not self._still_shown and self._settings is not None:
            self._still_shown = True
            yield from _still(self._settings, self._utc_s)
            if self._mode:
                yield ViewMessage("/mode", self._mode)
        if call is not CoreCall.TICK:
            return
        if self._motion and self._due("/motion", FAST_PERIOD_S):
            yield ViewMessage("/motion", dict(self._motion))
        if self._tree_changed and self._due("/tree", RARE_PERIOD_S):
            self._tree_changed = False
            active = (each for each in self._nodes.values() if each.status != "IDLE")
            nodes = [{"path": n.path, "status": n.status, "message": n.message} for n in active]
            yield ViewMessage("/tree", {"nodes": nodes})

    def _of_fact(self, fact: Fact) -> Iterator[ViewMessage]:
        now_s = self._utc_s
        match fact:
            case Odometry(pose=pose, velocity=velocity) if pose.finite and velocity.finite:
                self._pose = pose
                self._motion["odometry"] = {
                    **_velocity(velocity.travel_mps, velocity.rotate_radps),
                    "x_m": fine(pose.x_m),
                    "y_m": fine(pose.y_m),
                    "heading_rad": fine(pose.heading_rad),
                }
                if self._due("/tf", FAST_PERIOD_S):
                    yield ViewMessage("/tf", frame_transform(now_s, ODOM, BASE_LINK, pose))
                if self._track.takes(pose.point) and self._due("/scene/track", TRACK_S):
                    drawn = line(self._track.points, _BLUE)
                    track = entity(now_s, ODOM, "track", lines=[drawn])
                    yield ViewMessage("/scene/track", scene(now_s, track))
            case Imu():
                felt = (
                    ("forward_mps2", fact.acceleration_x_mps2),
                    ("left_mps2", fact.acceleration_y_mps2),
                    ("up_mps2", fact.acceleration_z_mps2),
                )
                self._motion["imu"] = {
                    **_known((("roll_rad", fact.roll_rad), ("pitch_rad", fact.pitch_rad))),
                    "rotate_radps": fine(fact.gyro_z_radps),
                    **{name: round(value, 3) for name, value in felt if isfinite(value)},
                }
            case Joints():
                self._motion["wheels"] = {
                    "left_radps": _mean(fact.left_radps),
                    "right_radps": _mean(fact.right_radps),
                    **({"left_nm": _mean(fact.left_nm)} if fact.left_nm else {}),
                    **({"right_nm": _mean(fact.right_nm)} if fact.right_nm else {}),
                }
            case Battery(voltage_v=voltage_v, charge_ratio=charge_ratio):
                figures = (("voltage_v", voltage_v), ("charge_ratio", charge_ratio))
                self._motion["battery"] = _known(figures)
            case CameraAngles(pan_rad=pan_rad, tilt_rad=tilt_rad):
                self._motion["camera"] = {"pan_rad": fine(pan_rad), "tilt_rad": fine(tilt_rad)}
            case SecondOdometry(pose=pose) if pose.finite:
                if self._due("/pose/second_odometry", SLOW_PERIOD_S):
                    yield ViewMessage("/pose/second_odometry", pose_in_frame(now_s, ODOM, pose))
            case LaserScan():
                if self._due("/scan", SLOW_PERIOD_S):
                    yield ViewMessage("/scan", _scan(now_s, fact))
            case Frame(data=data):
                thumbnail = _thumbnail(data)
                if thumbnail is not None:
                    yield ViewMessage("/camera", compressed_image(now_s, CAMERA, thumbnail))
            case MapToOdom(pose):
                self._map_origin = pose.inverse
            case NavigationStatus() | NavigationFeedback():
                yield from self._of_navigation(fact)
            case PlannedPath(points=points) if points:
                yield from self._of_path(fact)
            case _:
                pass

    def _of_navigation(self, fact: NavigationStatus | NavigationFeedback) -> Iterator[ViewMessage]:
        """Yield the state of a goal of the navigation, and its feedback at a limited rate."""
        if self._navigation.get("goal") != fact.number:
            self._navigation = {"goal": fact.number, "state": "", "text": ""}
        if isinstance(fact, NavigationStatus):
            parts = (fact.code and f"{fact.code_name} {fact.code}".strip(), fact.text)
            text = ", ".join(str(each) for each in parts if each)
            self._navigation |= {"state": fact.state.value, "text": text}
        else:
            remaining = () if fact.remaining_m is None else (("remaining_m", fact.remaining_m),)
            self._navigation |= {**_known(remaining), "recoveries": fact.recoveries}
            if not self._due("/navigation", SLOW_PERIOD_S):
                return
        yield ViewMessage("/navigation", dict(self._navigation))

    def _of_path(self, path: PlannedPath) -> Iterator[ViewMessage]:
        """Yield the planner's path of the active motion; those of previews are not shown."""
        request = self._path_request
        if request is None or request.number != path.number:
            return
        origin = self._map_origin if request.frame is TargetFrame.MAP else Pose()
        points = [origin.compose(Pose(each.x_m, each.y_m)).point for each in path.points]
        goal = entity(self._utc_s, ODOM, "goal", lines=[line(points, _GREEN)])
        yield ViewMessage("/scene/goal", scene(self._utc_s, goal))

    def _of_report(self, report: Report) -> Iterator[ViewMessage]:
        parts = (report.stage and report.stage.name, report.text)
        text = ", ".join(each for each in parts if each)
        name = report.kind.name if report.identity is None else str(report.identity)
        yield ViewMessage("/log", log(self._utc_s, report.severity, text, name))
        if report.identity is None or report.stage is None:
            return
        if report.stage is Stage.STARTED and report.identity in self._requests:
            if points := self._track_points(self._requests[report.identity]):
                self._aim = report.identity
                drawn = line([self._pose.point, *points], _GREEN)
                goal = entity(self._utc_s, ODOM, "goal", lines=[drawn])
                yield ViewMessage("/scene/goal", scene(self._utc_s, goal))
        elif report.stage.terminal:
            self._requests.pop(report.identity, None)
            if report.identity == self._aim:
                self._aim = None
                yield ViewMessage("/scene/goal", scene(self._utc_s))

    def _track_points(self, request: Motion) -> list[Point]:
        """Return the line ends of a motion that starts at the present pose."""
        if self._settings is not None and in_map(request, self._settings):
            assert isinstance(request, MoveTo | FollowPath)
            request = request.moved(self._map_origin)
        segments = request.segments(self._pose)
        return [each.end.point for each in segments if isinstance(each, Line)]


class _Track:
    """Track of the rover: few points, at distances that grow with its length."""

    def __init__(self) -> None:
        self.points: list[Point] = []
        self._apart_m = _TRACK_M

    def takes(self, point: Point) -> bool:
        """Add a point that is far enough from the last; return whether a line can be drawn."""
        if self.points and point.distance_m(self.points[-1]) < self._apart_m:
            return False
        if len(self.points) == _MAX_TRACK_POINTS:
            self.points = self.points[::2]
            self._apart_m *= 2
        self.points.append(point)
        return len(self.points) > 1


def _velocity(travel_mps: float, rotate_radps: float) -> Plain:
    return {"travel_mps": fine(travel_mps), "rotate_radps": fine(rotate_radps)}


def _known(figures: Iterable[tuple[str, float | None]]) -> Plain:
    """Return the figures that are known and finite."""
    return {name: fine(value) for name, value in figures if value is not None and isfinite(value)}


def _mean(values: tuple[float, ...]) -> float:
    return fine(sum(values) / len(values)) if values else 0.0


def _scan(utc_s: float, fact: LaserScan) -> Plain:
    """Return a scan; rays without a return have range 0, at the laser itself."""
    end_rad = fact.angle_min_rad + (len(fact.ranges_m) - 1) * fact.angle_increment_rad
    ranges_m = (round(each, 2) if isfinite(each) else 0.0 for each in fact.ranges_m)
    return laser_scan(utc_s, BASE_LINK, fact.angle_min_rad, end_rad, ranges_m)


def _still(settings: Settings, utc_s: float) -> Iterator[ViewMessage]:
    """Yield the messages that do not change after a start of the executive."""
    footprint = settings.footprint
    if footprint is not None:
        size_m = (footprint.length_m, footprint.width_m, _HEIGHT_M)
        body = cube(Pose(z_m=_HEIGHT_M / 2), size_m, _GREY)
        yield ViewMessage(
            "/scene/rover", scene(utc_s, entity(utc_s, BASE_LINK, settings.asset, cubes=[body]))
        )
    if settings.zones.not_empty:
        drawn = [_zone(utc_s, each) for each in settings.zones]
        yield ViewMessage("/scene/zones", scene(utc_s, *drawn))


def _zone(utc_s: float, zone: KeepIn | KeepOut | KnownRock) -> Plain:
    if isinstance(zone, KnownRock):
        middle = Pose(zone.x_m, zone.y_m, _HEIGHT_M / 2)
        rock = cylinder(middle, zone.radius_m, _HEIGHT_M, _RED)
        return entity(utc_s, ODOM, zone.label, cylinders=[rock])
    corners = [Point(*corner) for corner in zone.corners_m]
    color = _RED if isinstance(zone, KeepOut) else _GREEN
    return entity(utc_s, ODOM, zone.label, lines=[line([*corners, corners[0]], color)])


def _thumbnail(picture: bytes) -> bytes | None:
    """Return a small JPEG of a picture; None without Pillow, or if it cannot be decoded."""
    try:
        from PIL import Image
    except ImportError:
        return None
    with suppress(OSError, ValueError, SyntaxError), Image.open(io.BytesIO(picture)) as image:
        image.draft("RGB", _THUMBNAIL_PX)
        small = image.convert("RGB")
        small.thumbnail(_THUMBNAIL_PX)
        out = io.BytesIO()
        small.save(out, "JPEG", quality=60)
        return out.getvalue()
    return None
