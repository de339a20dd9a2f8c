"""The command `rover robot`: the group of `rover robot new` and `rover robot check`."""

import click

from adapters.cli.robot_check import check
from adapters.cli.robot_new import new


@click.group()
def robot() -> None:
    """Make the files of a robot, and check them.

    \b
    Examples:
      rover robot new scout
      rover robot check scout
    """


robot.add_command(check)
robot.add_command(new)
