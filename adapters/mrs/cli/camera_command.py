"""The camera's operations among the sub-commands of `rover command`."""

from typing import Final

import click

from adapters.mrs.cli.arguments import Operation, angle
from adapters.mrs.cli.sending import Sending
from executive.commands import MoveCameraAngles, SetCameraAngles, SetCameraRotateSpeed, TakePicture

_PIXELS: Final = click.IntRange(1, 65535)
_DEFAULT: Final = "The camera's by default."


@click.command("setCameraAngles", cls=Operation)
@click.option("--pan", "pan_rad", type=angle, help="Counter-clockwise positive; kept if left out.")
@click.option("--tilt", "tilt_rad", type=angle, help="Upward positive; kept if left out.")
@click.pass_obj
def set_camera_angles(sending: Sending, pan_rad: float | None, tilt_rad: float | None) -> None:
    """Point the camera.

    \b
    Example:
      rover command setCameraAngles --pan -45deg --tilt 10deg
    """
    _some_angle(pan_rad, tilt_rad)
    sending.send(SetCameraAngles(pan_rad, tilt_rad))


@click.command("moveCameraAngles", cls=Operation)
@click.option("--pan", "pan_rad", type=angle, help="How far to the left.")
@click.option("--tilt", "tilt_rad", type=angle, help="How far up.")
@click.pass_obj
def move_camera_angles(sending: Sending, pan_rad: float | None, tilt_rad: float | None) -> None:
    """Turn the camera from where it points.

    \b
    Example:
      rover command moveCameraAngles --pan 10deg
    """
    _some_angle(pan_rad, tilt_rad)
    sending.send(MoveCameraAngles(pan_rad or 0.0, tilt_rad or 0.0))


@click.command("setCameraRotateSpeed", cls=Operation)
@click.argument("speed_radps", metavar="SPEED", type=angle)
@click.pass_obj
def set_camera_rotate_speed(sending: Sending, speed_radps: float) -> None:
    """Set the greatest angular speed of the camera (per second).

    \b
    Example:
      rover command setCameraRotateSpeed 30deg
    """
    sending.send(SetCameraRotateSpeed(speed_radps))


@click.command("takePicture", cls=Operation)
@click.option("--width", "width_px", type=_PIXELS, metavar="PIXELS", help=_DEFAULT)
@click.option("--height", "height_px", type=_PIXELS, metavar="PIXELS", help=_DEFAULT)
@click.option(
    "--format",
    type=click.Choice(["JPG", "PNG", "RAW"], case_sensitive=False),
    help=_DEFAULT,
)
@click.option("--quality", type=click.IntRange(1, 100), help="Of a JPG; the camera's by default.")
@click.pass_obj
def take_picture(
    sending: Sending,
    width_px: int | None,
    height_px: int | None,
    format: str | None,
    quality: int | None,
) -> None:
    """Take a picture and store it aboard; a camera refuses what it cannot do.

    \b
    Examples:
      rover command takePicture
      rover command takePicture --format PNG
      rover command takePicture --width 640 --height 480 --quality 80
    """
    sending.send(TakePicture(width_px, height_px, format, quality))


def _some_angle(*angles_rad: float | None) -> None:
    if all(angle_rad is None for angle_rad in angles_rad):
        raise click.UsageError("give --pan, --tilt or both")
