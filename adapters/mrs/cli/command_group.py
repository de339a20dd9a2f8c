"""`rover command`: one sub-command for each MRS operation that commands the rover."""

from collections.abc import Callable
from typing import Any, Final

import click

from adapters.mrs.cli.action_command import action
from adapters.mrs.cli.arguments import Operation, angle, place
from adapters.mrs.cli.camera_command import (
    move_camera_angles,
    set_camera_angles,
    set_camera_rotate_speed,
    take_picture,
)
from adapters.mrs.cli.file_operations import delete_file, move_file
from adapters.mrs.cli.sending import Sending
from adapters.mrs.cli.setting_command import (
    set_position_compensation,
    set_rotate_speed,
    set_status_interval,
    set_travel_speed,
)
from adapters.mrs.cli.target import Target, to_option
from executive.commands import (
    Arrival,
    DriveFor,
    FollowPath,
    MoveForward,
    MoveTo,
    Resume,
    RotateBy,
    RotateTo,
    Stop,
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
@click.option(
    "--no-wait",
    is_flag=True,
    help="Return once the command is taken: by the rover, or by an orbiter that stores it.",
)
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
      rover command --to rover.local:21000 takePicture
      rover command action VIDEO ON

    \b
    Exit status: 0 EXECUTED, 1 refused or ended otherwise, 2 makes no sense, 3 cannot be reached.
    """
    ctx.obj = Sending(to, source, command_id, lifetime_s, wait=not no_wait)


def _operation(name: str) -> Callable[[_Function], click.Command]:
    """Add a function as the sub-command of an operation's name."""

    def add(function: _Function) -> click.Command:
        decorate = command.command(name, cls=Operation)
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
    """Drive straight on by DISTANCE (m); negative is backward.

    \b
    Examples:
      rover command moveForward 1.5
      rover command moveForward -1 --replace
    """
    sending.send(MoveForward(distance_m), arrival)


@_operation("rotateTo")
@click.argument("heading_rad", metavar="HEADING", type=angle)
@_replace
def _rotate_to(sending: Sending, heading_rad: float, arrival: Arrival) -> None:
    """Turn on the spot to an absolute HEADING.

    \b
    Example:
      rover command rotateTo 90deg
    """
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
    """Hold TRAVEL (m/s) and ROTATE (rad/s) for DURATION (s), then stand.

    \b
    Examples:
      rover command drive 0.2 0 5
      rover command drive 0 -0.3 4
    """
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
    """Stand still at once, end all goals, and stay so until `resume`.

    \b
    Example:
      rover command stop
    """
    sending.send(Stop())


@_operation("resume")
def _resume(sending: Sending) -> None:
    """Let the rover move again after a stop, or a hazard that is gone.

    \b
    Example:
      rover command resume
    """
    sending.send(Resume())


for _each in (
    set_travel_speed,
    set_rotate_speed,
    set_position_compensation,
    set_status_interval,
    set_camera_angles,
    move_camera_angles,
    set_camera_rotate_speed,
    take_picture,
    action,
    delete_file,
    move_file,
):
    command.add_command(_each)
