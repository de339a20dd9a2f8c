"""`rover-executive`: the process aboard that takes commands and moves the rover."""

import sys
from pathlib import Path
from typing import Final

import click

FAILED: Final = 1


@click.command(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.option("--asset", default="jackal", show_default=True, help="Asset name, or its YAML file.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of the MRS link.")
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=41000,
    show_default=True,
    help="TCP port of the MRS link; 0 takes a free one, which is printed.",
)
@click.option(
    "--data",
    type=click.Path(file_okay=False, path_type=Path),
    envvar="ROVER_DATA",
    show_envvar=True,
    help="Folder of ledger and pictures.  [default: ~/.local/share/rover/ASSET]",
)
@click.option(
    "--ros-params",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="ROS parameter file.  [default: ASSET.ros.yaml in config/]",
)
@click.option(
    "--log-level",
    type=click.Choice(["debug", "info", "warning", "error"]),
    default="info",
    show_default=True,
    help="The least that is logged, on standard error.",
)
@click.pass_context
def command(
    context: click.Context,
    asset: str,
    host: str,
    port: int,
    data: Path | None,
    ros_params: Path | None,
    log_level: str,
) -> None:
    """Run the executive of an asset until SIGINT or SIGTERM.

    It prints the address of its MRS link, then logs one line an event. On the way out the rover
    stands, and what was under way ends CANCELLED. What follows --ros-args goes to ROS.

    \b
    Examples:
      rover-executive
      rover-executive --port 0 --data /tmp/rover
      rover-executive --ros-args -p use_sim_time:=true -r __ns:=/rover1

    \b
    Exit status:
      0  ended by a signal, the rover standing
      1  cannot start; the text says why
      2  the command line or a settings file makes no sense
    """
    from adapters.ros.presence import require_ros

    require_ros()
    from adapters.onboard.frugal import do_without

    do_without()
    from adapters.onboard.logs import log_to_stderr
    from adapters.onboard.service import Options, StartError, serve
    from adapters.ros.parameters import ParameterError
    from executive.settings import SettingsError, config_folder, load_settings

    log_to_stderr(log_level)
    try:
        settings = load_settings(asset)
        parameters = ros_params or config_folder() / f"{settings.asset}.ros.yaml"
        serve(Options(settings, host, port, data, parameters, tuple(context.obj or ())))
    except (SettingsError, ParameterError) as error:
        raise click.UsageError(str(error)) from error
    except StartError as error:
        click.echo(f"Error: {error}", err=True)
        sys.exit(FAILED)


def main() -> None:
    """Run the command with what is not for ROS."""
    from adapters.ros.arguments import split_ros_arguments

    own, ros = split_ros_arguments(sys.argv[1:])
    command(args=own, obj=ros, prog_name="rover-executive")


if __name__ == "__main__":
    main()
