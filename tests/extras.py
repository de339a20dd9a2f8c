"""The command `rover extras`; the launcher has installed the packages before it starts."""

import sys
from pathlib import Path

import click


@click.command()
def extras() -> None:
    """Install the packages of all extras and of the tests.

    The launcher `./rover` does so, from requirements-test.lock. Campaigns, `controller: mpc`, ROS
    bags, calibration and PostgreSQL need them. Without the launcher use pip.

    \b
    Examples:
      rover extras
      pip install 'rover-executive[campaign,mpc]'
    """
    if not Path(sys.prefix, "rover-full-stamp").is_file():
        raise click.ClickException("this environment is not that of ./rover: use pip")
    click.echo(f"all extras are installed in {sys.prefix}")
