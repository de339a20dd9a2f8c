"""`rover watch`: the behaviour tree of a running executive, live in the terminal."""

import click

from adapters.process import asset_option


@click.command()
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
def watch(asset: str, domain_id: int, once: bool) -> None:
    """Show the behaviour tree, the mode, and why the rover stands or moves.

    Ends with Ctrl-C. Where no executive is heard within a few seconds, or none any more, the exit
    status is 3.

    \b
    Examples:
      rover watch
      rover watch --once
      rover watch --asset rover1 --domain-id 7
    """
    from adapters.ros import ParameterError
    from adapters.ros.tree_view import show_live, show_once

    try:
        (show_once if once else show_live)(asset, domain_id)
    except ParameterError as error:
        raise click.UsageError(str(error)) from error
