"""The operations that set how the rover moves, and tells, among those of `rover command`."""

import click

from adapters.mrs.cli.arguments import Operation, angle
from adapters.mrs.cli.sending import Sending
from executive.commands import (
    SetPositionCompensation,
    SetRotateSpeed,
    SetStatusInterval,
    SetTravelSpeed,
)


@click.command("setTravelSpeed", cls=Operation)
@click.argument("speed_mps", metavar="SPEED", type=float)
@click.pass_obj
def set_travel_speed(sending: Sending, speed_mps: float) -> None:
    """Set the greatest linear speed (m/s).

    \b
    Example:
      rover command setTravelSpeed 0.5
    """
    sending.send(SetTravelSpeed(speed_mps))


@click.command("setRotateSpeed", cls=Operation)
@click.argument("speed_radps", metavar="SPEED", type=angle)
@click.pass_obj
def set_rotate_speed(sending: Sending, speed_radps: float) -> None:
    """Set the greatest angular speed (per second).

    \b
    Example:
      rover command setRotateSpeed 30deg
    """
    sending.send(SetRotateSpeed(speed_radps))


@click.command("setPositionCompensation", cls=Operation)
@click.argument("x_m", metavar="X", type=float)
@click.argument("y_m", metavar="Y", type=float)
@click.argument("z_m", metavar="Z", type=float)
@click.argument("heading_rad", metavar="HEADING", type=angle)
@click.pass_obj
def set_position_compensation(
    sending: Sending, x_m: float, y_m: float, z_m: float, heading_rad: float
) -> None:
    """Set what is added to the measured pose (m, and an angle).

    \b
    Example:
      rover command setPositionCompensation 0.1 -0.2 0 5deg
    """
    sending.send(SetPositionCompensation(x_m, y_m, z_m, heading_rad))


@click.command("setStatusInterval", cls=Operation)
@click.argument("interval_s", metavar="SECONDS", type=float)
@click.pass_obj
def set_status_interval(sending: Sending, interval_s: float) -> None:
    """Set how often telemetry is sent; 0 sends it on change only.

    \b
    Example:
      rover command setStatusInterval 2
    """
    sending.send(SetStatusInterval(interval_s))
