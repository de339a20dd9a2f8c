"""The command `rover watch`: an executive's behaviour tree, over ROS or MRS, or of a recording."""

import sys
from pathlib import Path

import click
from click.core import ParameterSource

from adapters.mrs.cli import RoverTarget, connect, run, to_option
from adapters.process import asset_option


@click.command()
@to_option
@asset_option("Asset name: its ROS namespace.")
@click.option(
    "--domain-id",
    type=click.IntRange(0, 232),
    envvar="ROS_DOMAIN_ID",
    show_envvar=True,
    default=0,
    show_default=True,
    help="ROS domain of the executive.",
)
@click.option("--once", is_flag=True, help="Print one snapshot and exit.")
@click.option(
    "--file",
    "recording",
    metavar="RUN.mcap",
    type=click.Path(path_type=Path),
    help="Show a recorded run instead: keys rewind, step, and jump between reports.",
)
@click.option(
    "--at",
    metavar="MOMENT",
    help="With --file, print one time: seconds, a command's SOURCE:NUMBER, or a reason's name.",
)
@click.option(
    "--html",
    "page",
    metavar="PAGE.html",
    type=click.Path(dir_okay=False, path_type=Path),
    help="With --file, write an HTML page with a time slider; it needs no network.",
)
def watch(
    to: RoverTarget,
    asset: str,
    domain_id: int,
    once: bool,
    recording: Path | None,
    at: str | None,
    page: Path | None,
) -> None:
    """Show the behaviour tree, the mode, and the reason for standstill or motion.

    Uses ROS; with --to, or with ROVER_URI and without --domain-id, the MRS, which needs no local
    ROS. Ends with Ctrl-C, or for a recorded run with q. The exit status is 3 if no executive is
    received within a few seconds, or its contact is lost.

    \b
    Examples:
      rover watch
      rover watch --once
      rover watch --to rover.local
      rover watch --asset rover1 --domain-id 7
      rover watch --file run.mcap
      rover watch --file run.mcap --at 12.5
      rover watch --file run.mcap --at MOE:3
      rover watch --file run.mcap --at WHEELS_OFF_COMMAND
      rover watch --file run.mcap --html run.html
    """
    if recording is not None:
        if once:
            raise click.UsageError("--once needs a running rover: with --file use --at MOMENT")
        if at is not None and page is not None:
            raise click.UsageError("--at and --html: choose one")
        _watch_file(recording, at, page)
        return
    if at is not None or page is not None:
        raise click.UsageError("--at and --html need --file RUN.mcap")
    if _by_mrs():
        run(_watch_by_mrs(to, once))
        return
    from adapters.ros import ParameterError
    from adapters.ros.tree_view import show_live, show_one

    try:
        (show_one if once else show_live)(asset, domain_id)
    except ParameterError as error:
        raise click.UsageError(str(error)) from error


def _by_mrs() -> bool:
    """Whether a rover is selected by its MRS address.

    Raises:
        UsageError: it is selected for ROS, too.
    """
    source = click.get_current_context().get_parameter_source
    of_ros = [
        name for name in ("asset", "domain_id") if source(name) is ParameterSource.COMMANDLINE
    ]
    if source("to") is ParameterSource.ENVIRONMENT:
        return not of_ros
    by_mrs = source("to") is ParameterSource.COMMANDLINE
    if by_mrs and of_ros:
        raise click.UsageError("--asset and --domain-id select ROS, --to the MRS: choose one")
    return by_mrs


async def _watch_by_mrs(to: RoverTarget, once: bool) -> None:
    from trees.screen import Screen, show_once

    async with await connect(to) as client:
        asset = (await client.get_asset()).asset
        trees = await client.tree_snapshots()
        first = await anext(trees)
        if once:
            show_once(asset, first)
            return
        with Screen(asset) as screen:
            screen.show(first)
            async for snapshot in trees:
                screen.show(snapshot)


def _watch_file(recording: Path, at: str | None, page: Path | None) -> None:
    from adapters.cli.watch_file import browse, show_moment, write_page
    from adapters.recording import RecordingError

    try:
        if page is not None:
            write_page(recording, page)
            click.echo(page)
        elif at is not None:
            show_moment(recording, at)
        elif sys.stdin.isatty() and sys.stdout.isatty():
            browse(recording, "0")
        else:
            raise click.UsageError("without a terminal give one time: --at 12.5")
    except RecordingError as error:
        raise click.UsageError(str(error)) from error
    except OSError as error:
        raise click.UsageError(f"{page} cannot be written: {error.strerror}") from error
