"""`validate` checks a received command: id, arguments, time, mode, queue. It changes no state.

The bounds of arguments are defined in the declarations of the requests. Their checks are built once
on import, so that a path that does not exist in the settings raises then.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from math import inf, isfinite
from operator import attrgetter
from typing import Any, Final, Protocol, assert_never

from executive.commands.catalogue import (
    OWN_LINKS,
    ROS_LINK,
    ROS_SOURCE,
    Command,
    FollowPath,
    Motion,
    MoveCameraAngles,
    MoveTo,
    Request,
    SetCameraAngles,
    SetCameraRotateSpeed,
    TakePicture,
    Waypoint,
)
from executive.commands.declaration import (
    ACCEPTED,
    Argument,
    AssetChoice,
    Family,
    FilePath,
    Limit,
    Mode,
    SymmetricRange,
    ValueRange,
    all_declarations,
    arguments_of,
    declaration_of,
)
from executive.settings import Controller, LocomotionKind, Settings, TargetFrame
from executive.state import Status, check_path
from executive.values.facts import Source
from executive.values.geometry import Point
from executive.values.quantities import quantity_text
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import printable

_Check = Callable[[Any, Settings], Refusal | None]


def check_arguments(request: Request, settings: Settings, here: Point) -> Refusal | None:
    """Return a refusal if the arguments are invalid for a rover at this position, or None."""
    match request:
        case MoveTo(target, controller=controller):
            return _waypoint(target, here, settings) or _controller(controller, settings)
        case FollowPath(waypoints, controller=controller):
            return _path(waypoints, here, settings) or _controller(controller, settings)
        case SetCameraAngles() | MoveCameraAngles() | SetCameraRotateSpeed() if (
            settings.camera.fixed
        ):
            text = f"the camera of {settings.asset} does not turn: its settings have no pan or tilt"
            return Refusal(Reason.NOT_SUPPORTED, text)
        case TakePicture() if not settings.camera.formats:
            text = f"{settings.asset} has no camera: its settings have no camera.formats"
            return Refusal(Reason.NOT_SUPPORTED, text)
        case _:
            return _first_refusal(_CHECKS[type(request)], request, settings)


def _first_refusal(checks: tuple[_Check, ...], item: object, settings: Settings) -> Refusal | None:
    for each in checks:
        if refusal := each(item, settings):
            return refusal
    return None


def _waypoint(target: Waypoint, here: Point, settings: Settings) -> Refusal | None:
    if refusal := _first_refusal(_FINITE, target, settings):
        return refusal
    distance_m = here.distance_m(Point(target.x_m, target.y_m))
    return _range("distance", distance_m, 0.0, settings.drive.distance_m, "m") or _first_refusal(
        _WAYPOINT, target, settings
    )


def _path(waypoints: tuple[Waypoint, ...], here: Point, settings: Settings) -> Refusal | None:
    if not waypoints:
        return Refusal(Reason.EMPTY_PATH, "the path has no waypoint: give one at least", argument=1)
    refusal = _COUNT(len(waypoints), settings)
    for waypoint in waypoints:
        refusal = refusal or _waypoint(waypoint, here, settings)
        here = Point(waypoint.x_m, waypoint.y_m)
    return refusal


def _controller(chosen: Controller | None, settings: Settings) -> Refusal | None:
    if chosen is None:
        return None
    if settings.locomotion is not LocomotionKind.VELOCITY:
        text = f"controller {chosen.value}: {settings.asset} drives by itself; leave it out"
    elif chosen is Controller.MPC and not settings.offers_mpc:
        text = (
            f"controller mpc: {settings.asset} does not offer it; leave it out, or set"
            " mpc.selectable to true in the settings of the asset, which needs the extra mpc"
        )
    elif chosen is Controller.NAVIGATION and not settings.offers_navigation:
        text = (
            f"controller navigation: {settings.asset} does not offer it; leave it out, or add the"
            " section navigation to the settings of the asset"
        )
    else:
        return None
    return Refusal(Reason.NOT_SUPPORTED, text, argument=_CONTROLLER.position)


def _range(
    name: str, value: float, low: float, high: float, unit: str, argument: int = 1
) -> Refusal | None:
    if not isfinite(value):
        return Refusal(
            Reason.NOT_FINITE,
            f"{name} is {value}: a finite number is needed",
            (Figure(name, value, unit),),
            argument,
        )
    if low <= value <= high:
        return None
    bound = low if value < low else high
    side = "below" if value < low else "above"
    return Refusal(
        Reason.OUT_OF_RANGE,
        f"{name} {quantity_text(value, unit)} is {side} its bound of {quantity_text(bound, unit)}",
        (Figure(name, value, unit), Figure("bound", bound, unit)),
        argument,
    )


def _choice(argument: Argument, value: Any, given: Any) -> Refusal | None:
    name, unit, position = argument.name, argument.unit, argument.position
    if isinstance(given, tuple):
        if value in given:
            return None
        text = f"{name} {value[:20]}: this camera provides {', '.join(given)}"
        return Refusal(Reason.NOT_SUPPORTED, text, argument=position)
    if value == given:
        return None
    text = f"{name} {value}: this camera provides {given}"
    figures = (Figure(name, value, unit), Figure("bound", given, unit))
    return Refusal(Reason.NOT_SUPPORTED, text, figures, position)


def _setting(limit: Limit) -> Callable[[Settings], Any]:
    """Return a function that reads a limit; KeyError if the settings have no such path."""
    if not isinstance(limit, str):
        return lambda _: limit
    kind: Any = Settings
    for name in limit.split("."):
        kind = {field.name: field.type for field in fields(kind)}[name]
    return attrgetter(limit)


def _check_of(argument: Argument) -> _Check:
    """Return a function that checks one argument of a request or composite."""
    value_of, bound_check = attrgetter(argument.field), _bound_check_of(argument)
    parts = tuple(map(_check_of, arguments_of(argument.kind)))

    def check_argument(item: Any, settings: Settings) -> Refusal | None:
        value = value_of(item)
        if value is None and argument.optional:
            return None
        refusal = bound_check(len(value) if argument.repeated else value, settings)
        if refusal is not None or not parts:
            return refusal
        for composite in value if argument.repeated else (value,):
            if refusal := _first_refusal(parts, composite, settings):
                return replace(refusal, argument=argument.position)
        return None

    return check_argument


def _bound_check_of(argument: Argument) -> _Check:
    """Return a function that checks a value against the bound of an argument."""
    name, unit, position = argument.name, argument.unit, argument.position
    match argument.bound:
        case ValueRange(low, high, or_zero):
            high_of = _setting(high)
            low_of = (lambda settings: -high_of(settings)) if low is None else _setting(low)

            def in_range(value: float, settings: Settings) -> Refusal | None:
                if or_zero and value == 0.0:
                    return None
                return _range(name, value, low_of(settings), high_of(settings), unit, position)

            return in_range
        case SymmetricRange(low, high):
            low_of, high_of = _setting(low), _setting(high)

            def in_span(value: float, settings: Settings) -> Refusal | None:
                span = high_of(settings) - low_of(settings)
                return _range(name, value, -span, span, unit, position)

            return in_span
        case AssetChoice(path):
            if path is None:
                text = f"the {name} of this camera's pictures is fixed"
                return lambda *_: Refusal(Reason.NOT_SUPPORTED, text, argument=position)
            given = _setting(path)
            return lambda value, settings: _choice(argument, value, given(settings))
        case FilePath():
            return lambda path, _: check_path(path, position)
        case None if argument.kind is float:
            return lambda value, _: _range(name, value, -inf, inf, unit, position)
        case None:
            return lambda *_: None
        case _:
            assert_never(argument.bound)


_CHECKS: Final = {each.kind: tuple(map(_check_of, each.arguments)) for each in all_declarations()}
_FAMILIES: Final = {each.kind: each.family for each in all_declarations()}
_COUNT: Final = _bound_check_of(declaration_of(FollowPath).arguments[0])
_CONTROLLER: Final = declaration_of(FollowPath).arguments[1]
_WAYPOINT: Final = tuple(map(_check_of, arguments_of(Waypoint)))
_FINITE: Final = tuple(_check_of(replace(each, bound=None)) for each in arguments_of(Waypoint))


SOURCE_PREFIX: Final = "plan:"
"""Prefix of the sources of plans, reserved for them."""
ABOARD_PREFIX: Final = "aboard:"
"""Prefix of the sources of the executive's own commands, reserved for it."""
_RESERVED: Final = {SOURCE_PREFIX: "plans", ABOARD_PREFIX: "the rover itself"}

QUEUED_FAMILIES: Final = {Family.MOTION, Family.CAMERA, Family.INSTANT}
NEEDS_LOCALIZATION: Final = {Family.MOTION, Family.PLAN_START}
"""Families that need a known position: a plan would fail at its first motion."""
_RECOVERY_HINT: Final = {
    Mode.STOPPED: "; send resume first",
    Mode.SAFE: "; send resume first",
    Mode.PLAN: "; suspend the plan first",
}


def source_of(plan_id: str) -> str:
    """Return the source of a plan's commands."""
    return f"{SOURCE_PREFIX}{plan_id}"


class Expirable(Protocol):
    """An object with a creation time and a lifetime."""

    @property
    def created_utc_s(self) -> float | None:
        """Creation time by its sender's clock; None if not given."""

    @property
    def lifetime_s(self) -> float | None:
        """Lifetime in seconds; None for no limit."""


def in_map(request: Request, settings: Settings) -> bool:
    """Return whether the waypoints of a request are in the map."""
    return (
        isinstance(request, MoveTo | FollowPath)
        and (request.frame or settings.frame) is TargetFrame.MAP
    )


def localized(request: Motion, status: Status, settings: Settings) -> Motion | Refusal:
    """Return a motion with its waypoints in the frame of the pose, by the newest transform.

    A refusal if they are in the map, and its transform is missing or old.
    """
    if not in_map(request, settings):
        return request
    assert isinstance(request, MoveTo | FollowPath)
    origin = status.map_origin
    return origin if isinstance(origin, Refusal) else request.moved(origin)


def check_lifetime(
    command: Expirable, utc_s: float, arrived_utc_s: float, waited_s: float = 0.0
) -> Refusal | None:
    """Return a refusal if it is too late to start the command, or None.

    Its age counts by UTC from creation, and by the monotonic clock from arrival: a step of UTC
    extends no lifetime.
    """
    if command.lifetime_s is None:
        return None
    age_s = waited_s
    if command.created_utc_s is not None:
        travelled_s = max(arrived_utc_s - command.created_utc_s, 0.0)
        age_s = max(utc_s - command.created_utc_s, travelled_s + waited_s)
    if age_s <= command.lifetime_s:
        return None
    return Refusal(
        Reason.EXPIRED,
        f"command is {age_s:.3g} s old, its lifetime is {command.lifetime_s:g} s",
        (Figure("age", age_s, "s"), Figure("lifetime", command.lifetime_s, "s")),
    )


MAX_SOURCE_LENGTH: Final = 256
"""Maximum length in characters of a source name, which every report on its commands repeats."""


def is_valid_source(name: str) -> bool:
    """Whether a source name is valid: short, printable, and not reserved."""
    short = 0 < len(name) <= MAX_SOURCE_LENGTH and bool(name.strip())
    return short and name.isprintable() and not name.startswith(tuple(_RESERVED))


def check_identity(command: Command) -> Refusal | None:
    """Return a refusal if the sender may not use this source and number, or None.

    Only plans use a plan's source, only the executive its own, and only ROS clients theirs. A
    sender that the link has authenticated uses its authenticated name only. Refused commands are
    not recorded: their numbers would count as used by another source.
    """
    source, number = command.identity.source, command.identity.command_id
    if command.peer is not None and command.peer != source:
        why = f"its sender is {command.peer} by its certificate"
    elif command.link in OWN_LINKS:
        return None
    elif reserved := next(filter(source.startswith, _RESERVED), None):
        why = f"sources that begin with {reserved} are reserved for {_RESERVED[reserved]}"
    elif source == ROS_SOURCE and command.link != ROS_LINK:
        why = f"the source {ROS_SOURCE} is reserved for ROS clients"
    elif number == 0 or not is_valid_source(source):
        why = (
            "a command needs a number other than 0 and a source of at most"
            f" {MAX_SOURCE_LENGTH} printable characters"
        )
    else:
        return None
    named = f"{source[:MAX_SOURCE_LENGTH]}:{number}"
    return Refusal(Reason.BAD_IDENTIFIER, printable(f"{named}: {why}"), argument=0)


def check_creation_time(command: Expirable, utc_s: float, tolerance_s: float) -> Refusal | None:
    """Return a refusal if the creation time is too far ahead of the clock, or None."""
    if command.created_utc_s is None or command.created_utc_s - utc_s <= tolerance_s:
        return None
    ahead_s = command.created_utc_s - utc_s
    return Refusal(
        Reason.CREATED_IN_FUTURE,
        f"creation time is {ahead_s:.3g} s ahead of the onboard clock, {tolerance_s:g} s allowed:"
        " synchronise the clocks",
        (Figure("ahead", ahead_s, "s"), Figure("bound", tolerance_s, "s")),
    )


def check_localized(status: Status, settings: Settings) -> Refusal | None:
    """Return a refusal if odometry is stale, so that the position is unknown, or None."""
    if status.odometry_fresh:
        return None
    age_s = status.odometry_age_s
    since = f"for {age_s:.2f} s" if isfinite(age_s) else "yet"
    text = f"no odometry {since}: the position of the rover is unknown"
    return Refusal(
        Reason.NO_ODOMETRY,
        status.rejections.explain(text, Source.ODOMETRY),
        (Figure("age", age_s, "s"), Figure("bound", settings.faults.odometry_stale.bound, "s")),
    )


def validate(
    command: Command, *, settings: Settings, status: Status, mode: Mode, queued: int, utc_s: float
) -> Refusal | None:
    """Return a refusal of the command, or None.

    `mode` is the mode that applies to the command; `queued` is the number of waiting and active
    goals.
    """
    request = command.request
    family = _FAMILIES[type(request)]
    refusal = (
        check_arguments(request, settings, status.pose.point)
        or check_creation_time(command, utc_s, settings.clock_tolerance_s)
        or check_lifetime(command, utc_s, utc_s)
    )
    if refusal:
        return refusal
    if mode not in ACCEPTED[family]:
        if status.emergency_stop:
            text = "emergency stop of the robot is active: release it there, then send resume"
            return Refusal(Reason.EMERGENCY_STOP, text)
        accepted = ", ".join(sorted(each.name for each in ACCEPTED[family]))
        text = f"not accepted in mode {mode.name} (needs {accepted}){_RECOVERY_HINT.get(mode, '')}"
        return Refusal(Reason.WRONG_MODE, text)
    if family in NEEDS_LOCALIZATION and (refusal := check_localized(status, settings)):
        return refusal
    if family in QUEUED_FAMILIES and queued >= settings.drive.queue_length:
        return Refusal(
            Reason.QUEUE_FULL,
            f"queue full: {queued} goals wait; retry later, or send stop",
            (Figure("queued", queued), Figure("bound", settings.drive.queue_length)),
        )
    return None
