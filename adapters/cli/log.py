"""The command `rover log`: lists commands and events of a rover, or of a recording."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from adapters.cli.history_options import (
    Moment,
    MomentType,
    date_and_time,
    file_option,
    query_history,
    read_file,
    since_began,
    utc_of,
)
from adapters.explanation import Entry, LogFilter, TimeFormatter, entries, entry_line
from adapters.mrs.cli import RoverTarget, connect, echo_json, echo_line, json_option, run, to_option
from executive.commands import Mode
from executive.history import RunHistory
from executive.values.reports import Severity

if TYPE_CHECKING:
    from adapters.mrs.ground import MrsClient

PAGE: Final = 1000
"""Maximum reports of one query."""


class _SeverityType(click.Choice[str]):
    """A severity, or the beginning of its name."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the whole name."""
        begun = [each for each in self.choices if each.startswith(str(value).lower())]
        return super().convert(begun[0] if len(begun) == 1 else value, param, ctx)


@click.command()
@to_option
@file_option
@click.option("--follow", is_flag=True, help="Print each further report until Ctrl-C.")
@click.option("--command", metavar="COMMAND", help="One command: its number, or SOURCE:NUMBER.")
@click.option("--source", help="Commands of this source.")
@click.option(
    "--severity",
    type=_SeverityType([each.name.lower() for each in Severity], case_sensitive=False),
    default=Severity.INFORMATIONAL.name.lower(),
    show_default=True,
    help="Minimum severity; its beginning is enough, as warn.",
)
@click.option("--since", type=MomentType(), help="From this time on.")
@click.option("--until", type=MomentType(), help="Up to this time.")
@click.option(
    "--mode",
    type=click.Choice([each.name.lower() for each in Mode], case_sensitive=False),
    help="Reports in this mode.",
)
@click.option("--unfold", is_flag=True, help="List each report of a command on a separate line.")
@json_option
def log(
    to: RoverTarget,
    recording: Path | None,
    follow: bool,
    command: str | None,
    source: str | None,
    severity: str,
    since: Moment | None,
    until: Moment | None,
    mode: str | None,
    unfold: bool,
    as_json: bool,
) -> None:
    """List commands, each with its life cycle on one line, and events.

    A command is listed if one of its reports matches. --since and --until are a time before now,
    such as 10min, for a recording after its start; or today, yesterday, or a time in UTC, such as
    2026-05-04T10:30. Without --since the last 1000 reports of a rover are read.

    \b
    Examples:
      rover log
      rover log --since 10min --severity warn
      rover log --follow
      rover log --file run.mcap
      rover log --file run.mcap --command MOE:1 --unfold
      rover log --file run.mcap --severity warning --since 2
      rover log --file run.mcap --json
    """
    in_mode = None if mode is None else Mode[mode.upper()]
    wanted = LogFilter(command, source, Severity[severity.upper()], mode=in_mode)
    if follow and (recording is not None or until is not None or mode is not None):
        raise click.UsageError("--follow excludes --file, --until and --mode")
    if recording is None:
        run(_query(to, wanted, since, until, _Printer(unfold or follow, as_json), follow))
        return
    history, began_utc_s = read_file(recording)
    _Printer(unfold, as_json, since_began(began_utc_s)).list_all(
        history,
        replace(
            wanted,
            since_utc_s=utc_of(since, began_utc_s, 1.0),
            until_utc_s=utc_of(until, began_utc_s, 1.0),
        ),
    )


class _Printer:
    def __init__(self, unfold: bool, as_json: bool, when: TimeFormatter = date_and_time) -> None:
        self._unfold = unfold
        self._as_json = as_json
        self._when = when

    def list_all(self, history: RunHistory, wanted: LogFilter) -> None:
        for each in entries(history, wanted, self._unfold):
            self.list(each)

    def list(self, entry: Entry) -> None:
        if self._as_json:
            echo_json(entry)
        else:
            echo_line(entry_line(entry, self._when))


async def _query(
    to: RoverTarget,
    wanted: LogFilter,
    since: Moment | None,
    until: Moment | None,
    printer: _Printer,
    follow: bool,
) -> None:
    async with await connect(to) as client:
        stream = client.notifications()
        history = await query_history(client, wanted.command, everything=wanted.command is None)
        now_utc_s = history.until_utc_s
        wanted = replace(
            wanted,
            since_utc_s=utc_of(since, now_utc_s, -1.0),
            until_utc_s=utc_of(until, now_utc_s, -1.0),
        )
        if wanted.since_utc_s is not None and wanted.command is None:
            history = await _with_older(client, history, wanted.since_utc_s)
        printer.list_all(history, wanted)
        known = {each.sequence for each in history.reports if each.sequence}
        while follow:
            sys.stdout.flush()
            report = (await anext(stream)).report
            if report.sequence not in known and wanted.matches(report):
                printer.list(report)


async def _with_older(client: "MrsClient", history: RunHistory, since_utc_s: float) -> RunHistory:
    """Return a history with older reports from the rover, back to a UTC time."""
    reports = list(history.reports)
    while reports and reports[0].utc_s > since_utc_s and reports[0].sequence > 1:
        first = reports[0].sequence
        since = max(1, first - PAGE)
        page = await client.get_notifications(since, None, first - since)
        older = [each.report for each in page if each.report.sequence < first]
        if not older:
            break
        reports[:0] = older
    return replace(history, reports=tuple(reports))
