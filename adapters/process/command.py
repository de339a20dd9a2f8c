"""One way to be a process: its command line, its log, its start errors and its exit status.

Exit status: 0 ended by a signal, 1 cannot start, go on or write its output, 2 the command line or a
settings file makes no sense, 141 nobody reads its output.
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import click

from adapters.process.log import log_to_stderr
from adapters.process.output import guard_output
from adapters.process.start import missing_package

SWITCH_S: Final = 0.001
"""So long does a thread wait at most for one that computes, as a stop's for the core's."""
ROS_ARGS: Final = "--ros-args"
PORT_NUMBER: Final = click.IntRange(0, 65535)
"""A TCP or UDP port; 0 is any that is free."""
EXISTING_FILE: Final = click.Path(exists=True, dir_okay=False, path_type=Path)
_Decorated = TypeVar("_Decorated", bound=Callable[..., Any])


class StartError(Exception):
    """A process cannot start, or cannot go on; the text says why and what to do."""


class ProcessCommand(click.Command):
    """The command line of a process that serves until a signal.

    Its callback raises StartError where it cannot start, and SettingsError (of the executive)
    where a file or an option makes no sense.
    """

    def main(self, *arguments: Any, **options: Any) -> Any:
        """Run it under its own name, also as `python -m`."""
        guard_output()
        return super().main(*arguments, **{"prog_name": self.name, **options})

    def invoke(self, ctx: click.Context) -> Any:
        """Run the process, and say in one line why it does not."""
        from executive.settings import SettingsError

        sys.setswitchinterval(SWITCH_S)
        try:
            return super().invoke(ctx)
        except SettingsError as error:
            raise click.UsageError(str(error), ctx) from error
        except (StartError, ImportError) as error:
            text = str(error) if isinstance(error, StartError) else missing_package(error)
            if text is None:
                raise
            raise click.ClickException(text) from error


class RosProcessCommand(ProcessCommand):
    """One that speaks ROS: `ctx.obj` has what stood between `--ros-args` and `--`."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse what is not for ROS."""
        own, ros = split_ros_arguments(args)
        ctx.obj = tuple(ros)
        return super().parse_args(ctx, own)


def process(name: str, *, ros: bool = True) -> Callable[[Callable[..., None]], ProcessCommand]:
    """Make a function the command line of a process; with `ros`, of one that speaks ROS.

    For example; the first argument is what followed `--ros-args`:

        @process("rover-relay")
        @click.option("--asset", default="jackal", show_default=True)
        @data_option("the bundles")
        @log_level_option
        @click.pass_obj
        def main(ros_arguments, asset, data): ...
    """
    settings = {"help_option_names": ["-h", "--help"], "max_content_width": 100}
    cls = RosProcessCommand if ros else ProcessCommand
    return click.command(name, cls=cls, context_settings=settings)


def split_ros_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line's own arguments, and those between `--ros-args` and `--`."""
    own: list[str] = []
    ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == ROS_ARGS:
            into = ros
        elif argument == "--" and into is ros:
            into = own
        else:
            into.append(argument)
    return own, ros


def _assets(_: click.Context, __: click.Parameter, begun: str) -> list[str]:
    """Return the names of assets that a shell may complete."""
    from executive.settings import config_folder, names_in

    return [name for name in names_in(config_folder()) if name.startswith(begun)]


def asset_option(
    help: str = "Asset name, or its YAML file.", default: str = "jackal"
) -> Callable[[_Decorated], _Decorated]:
    """Make `--asset`, whose names a shell completes."""
    return click.option(
        "--asset", default=default, show_default=True, shell_complete=_assets, help=help
    )


def data_option(contents: str, name: str = "ASSET") -> Callable[[_Decorated], _Decorated]:
    """Make `--data`, a folder for what must survive the process; None is `default_folder(name)`."""
    return click.option(
        "--data",
        type=click.Path(path_type=Path),
        envvar="ROVER_DATA",
        help=f"Folder of {contents}.  [default: $ROVER_DATA, or ~/.local/share/rover/{name}]",
    )


def _log_level(_: click.Context, __: click.Parameter, level: str) -> None:
    log_to_stderr(level)


log_level_option = click.option(
    "--log-level",
    type=click.Choice(["debug", "info", "warning", "error"]),
    default="info",
    show_default=True,
    expose_value=False,
    callback=_log_level,
    help="The least that is logged, on standard error.",
)
"""`--log-level`, which takes effect at once."""
