"""`rover log`: the history of commands and events."""

from pathlib import Path

import click

from adapters.cli.history_options import file_option, read_file, since_began
from adapters.explanation import Wanted, entries, entry_line
from adapters.mrs.cli import echo_json, json_option, say
from executive.commands import Mode
from executive.reports import Severity


@click.command()
@file_option
@click.option("--command", metavar="COMMAND", help="Of one: its number, or SOURCE:NUMBER.")
@click.option("--source", help="Of the commands of this source.")
@click.option(
    "--severity",
    type=click.Choice([each.name.lower() for each in Severity], case_sensitive=False),
    default=Severity.INFORMATIONAL.name.lower(),
    show_default=True,
    help="The least that is listed.",
)
@click.option("--since", "since_s", type=float, metavar="SECONDS", help="From this time on.")
@click.option("--until", "until_s", type=float, metavar="SECONDS", help="Up to this time.")
@click.option(
    "--mode",
    type=click.Choice([each.name.lower() for each in Mode], case_sensitive=False),
    help="What was reported in this mode.",
)
@click.option("--unfold", is_flag=True, help="List each report of a command on a line of its own.")
@json_option
def log(
    recording: Path,
    command: str | None,
    source: str | None,
    severity: str,
    since_s: float | None,
    until_s: float | None,
    mode: str | None,
    unfold: bool,
    as_json: bool,
) -> None:
    """List commands, each with its whole life on a line, and events.

    A command is listed if one of its reports is wanted. Times are seconds since the beginning of
    the recording.

    \b
    Examples:
      rover log --file run.mcap
      rover log --file run.mcap --command MOE:1 --unfold
      rover log --file run.mcap --severity warning --since 2
      rover log --file run.mcap --json
    """
    chronicle, began_utc_s = read_file(recording)
    wanted = Wanted(
        command,
        source,
        Severity[severity.upper()],
        None if since_s is None else began_utc_s + since_s,
        None if until_s is None else began_utc_s + until_s,
        None if mode is None else Mode[mode.upper()],
    )
    when = since_began(began_utc_s)
    for each in entries(chronicle, wanted, unfold):
        if as_json:
            echo_json(each)
        else:
            say(entry_line(each, when))
