"""`rover command`: one sub-command for each MRS operation that commands the rover."""

from collections.abc import Callable
from typing import Any, Final

import click

from adapters.mrs.action_command import action
from adapters.mrs.arguments import NEGATIVE, angle, place
from adapters.mrs.file_operations import delete_file, move_file
from adapters.mrs.sending import Sending
from adapters.mrs.target import Target, to_option
from executive.commands import (
    Arrival,
    DriveFor,
    FollowPath,
    MoveCameraAngles,
    MoveForward,
    MoveTo,
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
    Waypoint,
)

LARGEST_ID: Final = (1 << 63) - 1

_replace: Final = click.option(
    "--replace",
    "arrival",
    flag_value=Arrival.REPLACE,
    default=Arrival.APPEND,
    type=Arrival,
    help="Cancel the motion under way and what waits, instead of queueing behind it.",
)
_Function = Callable[..., Any]


def _named(_: click.Context, __: click.Parameter, name: str) -> str:
    if not name:
        raise click.BadParameter("a command needs a source: give a name")
    return name


def _positive(_: click.Context, __: click.Parameter, seconds: float | None) -> float | None:
    if seconds is not None and not seconds > 0.0:
        raise click.BadParameter(f"{seconds:g} is no time to live: give seconds above 0")
    return seconds


@click.group()
@to_option
@click.option(
    "--source",
    default="MOE",
    show_default=True,
    callback=_named,
    help="Name to command under.",
)
@click.option(
    "--id",
    "command_id",
    type=click.IntRange(1, LARGEST_ID),
    help="Command number, for a repeat; a new one by default.",
)
@click.option(
    "--lifetime",
    "lifetime_s",
    type=float,
    callback=_positive,
    metavar="SECONDS",
    help="Seconds from now after which it must not start.",
)
@click.option("--no-wait", is_flag=True, help="Return once the rover has taken the command.")
@click.pass_context
def command(
    ctx: click.Context,
    to: Target,
    source: str,
    command_id: int | None,
    lifetime_s: float | None,
    no_wait: bool,
) -> None:
    """Command a rover and watch how it goes, stage by stage.

    Lengths are in metres; angles in radians, or written as 90deg. Options of `command` itself
    stand before the operation.

    \b
    Examples:
      rover command moveTo 3 2 --heading 90deg
      rover command moveForward -1
      rover command --no-wait followPath 1,0 1,1,90deg
      rover command stop
      rover command resume
      rover command setCameraAngles --pan -45deg
      rover command --to rover.local:41000 takePicture
      rover command action VIDEO ON

    \b
    Exit status: 0 EXECUTED, 1 refused or ended otherwise, 2 makes no sense, 3 cannot be reached.
    """
    ctx.obj = Sending(to, source, command_id, lifetime_s, wait=not no_wait)


def _operation(name: str) -> Callable[[_Function], click.Command]:
    """Add a function as the sub-command of an operation's name; numbers may be negative."""

    def add(function: _Function) -> click.Command:
        decorate = command.command(name, context_settings=NEGATIVE)
        return decorate(click.pass_obj(function))

    return add


@_operation("moveTo")
@click.argument("x_m", metavar="X", type=float)
@click.argument("y_m", metavar="Y", type=float)
@click.option("--heading", "heading_rad", type=angle, help="Heading to take at the end.")
@click.option("--tolerance", "tolerance_m", type=float, help="How near is near enough, in m.")
@_replace
def _move_to(
    sending: Sending,
    x_m: float,
    y_m: float,
    heading_rad: float | None,
    tolerance_m: float | None,
    arrival: Arrival,
) -> None:
    """Turn towards X, Y (m, odometry frame), drive there, turn to a heading.

    \b
    Examples:
      rover command moveTo 3 2 --heading 90deg
      rover command moveTo -1 0.5 --replace
    """
    sending.send(MoveTo(Waypoint(x_m, y_m, heading_rad, tolerance_m)), arrival)


@_operation("moveForward")
@click.argument("distance_m", metavar="DISTANCE", type=float)
@_replace
def _move_forward(sending: Sending, distance_m: float, arrival: Arrival) -> None:
    """Drive straight on by DISTANCE (m); negative is backward."""
    sending.send(MoveForward(distance_m), arrival)


@_operation("rotateTo")
@click.argument("heading_rad", metavar="HEADING", type=angle)
@_replace
def _rotate_to(sending: Sending, heading_rad: float, arrival: Arrival) -> None:
    """Turn on the spot to an absolute HEADING."""
    sending.send(RotateTo(heading_rad), arrival)


@_operation("rotateBy")
@click.argument("angle_rad", metavar="ANGLE", type=angle)
@_replace
def _rotate_by(sending: Sending, angle_rad: float, arrival: Arrival) -> None:
    """Turn on the spot by ANGLE, counter-clockwise positive.

    \b
    Example:
      rover command rotateBy -90deg
    """
    sending.send(RotateBy(angle_rad), arrival)


@_operation("drive")
@click.argument("travel_mps", metavar="TRAVEL", type=float)
@click.argument("rotate_radps", metavar="ROTATE", type=float)
@click.argument("duration_s", metavar="DURATION", type=float)
@_replace
def _drive(
    sending: Sending, travel_mps: float, rotate_radps: float, duration_s: float, arrival: Arrival
) -> None:
    """Hold TRAVEL (m/s) and ROTATE (rad/s) for DURATION (s), then stand."""
    sending.send(DriveFor(travel_mps, rotate_radps, duration_s), arrival)


@_operation("followPath")
@click.argument(
    "places", metavar="X,Y[,HEADING[,TOLERANCE]]...", type=place, nargs=-1, required=True
)
@_replace
def _follow_path(sending: Sending, places: tuple[Waypoint, ...], arrival: Arrival) -> None:
    """Visit places in their order.

    X and Y are in m, odometry frame; TOLERANCE says how near is near enough, in m.

    \b
    Examples:
      rover command followPath 1,0 1,1,90deg -1,0
      rover command followPath 1,0,,0.1 1,1,90deg,0.05
    """
    sending.send(FollowPath(places), arrival)


@_operation("stop")
def _stop(sending: Sending) -> None:
    """Stand still at once, end all goals, and stay so until `resume`."""
    sending.send(Stop())


@_operation("resume")
def _resume(sending: Sending) -> None:
    """Let the rover move again after a stop, or a hazard that is gone."""
    sending.send(Resume())


@_operation("setTravelSpeed")
@click.argument("speed_mps", metavar="SPEED", type=float)
def _set_travel_speed(sending: Sending, speed_mps: float) -> None:
    """Set the greatest linear speed (m/s)."""
    sending.send(SetTravelSpeed(speed_mps))


@_operation("setRotateSpeed")
@click.argument("speed_radps", metavar="SPEED", type=angle)
def _set_rotate_speed(sending: Sending, speed_radps: float) -> None:
    """Set the greatest angular speed (per second)."""
    sending.send(SetRotateSpeed(speed_radps))


@_operation("setPositionCompensation")
@click.argument("x_m", metavar="X", type=float)
@click.argument("y_m", metavar="Y", type=float)
@click.argument("z_m", metavar="Z", type=float)
@click.argument("heading_rad", metavar="HEADING", type=angle)
def _set_position_compensation(
    sending: Sending, x_m: float, y_m: float, z_m: float, heading_rad: float
) -> None:
    """Set what is added to the measured pose (m, and an angle)."""
    sending.send(SetPositionCompensation(x_m, y_m, z_m, heading_rad))


@_operation("setCameraAngles")
@click.option("--pan", "pan_rad", type=angle, help="Counter-clockwise positive; kept if left out.")
@click.option("--tilt", "tilt_rad", type=angle, help="Upward positive; kept if left out.")
def _set_camera_angles(sending: Sending, pan_rad: float | None, tilt_rad: float | None) -> None:
    """Point the camera.

    \b
    Example:
      rover command setCameraAngles --pan -45deg --tilt 10deg
    """
    sending.send(SetCameraAngles(pan_rad, tilt_rad))


@_operation("moveCameraAngles")
@click.option("--pan", "pan_rad", type=angle, default="0", help="How far to the left.")
@click.option("--tilt", "tilt_rad", type=angle, default="0", help="How far up.")
def _move_camera_angles(sending: Sending, pan_rad: float, tilt_rad: float) -> None:
    """Turn the camera from where it points."""
    sending.send(MoveCameraAngles(pan_rad, tilt_rad))


@_operation("setCameraRotateSpeed")
@click.argument("speed_radps", metavar="SPEED", type=angle)
def _set_camera_rotate_speed(sending: Sending, speed_radps: float) -> None:
    """Set the greatest angular speed of the camera (per second)."""
    sending.send(SetCameraRotateSpeed(speed_radps))


@_operation("takePicture")
def _take_picture(sending: Sending) -> None:
    """Take a picture and store it aboard."""
    sending.send(TakePicture())


@_operation("setStatusInterval")
@click.argument("interval_s", metavar="SECONDS", type=float)
def _set_status_interval(sending: Sending, interval_s: float) -> None:
    """Set how often telemetry is sent; 0 sends it on change only."""
    sending.send(SetStatusInterval(interval_s))


command.add_command(action)
command.add_command(delete_file)
command.add_command(move_file)
