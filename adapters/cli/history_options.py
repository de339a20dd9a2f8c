"""What `rover log` and `rover why` share: where the history comes from, and its times."""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.core import ParameterSource

from adapters.explanation import UnknownCommandError
from adapters.mal import MalError
from executive.history import RunHistory

if TYPE_CHECKING:
    from adapters.mrs.ground import MrsClient


file_option: Final = click.option(
    "--file",
    "recording",
    metavar="RUN.mcap",
    type=click.Path(path_type=Path),
    help="Of a recorded run, not of the rover.",
)


def read_file(recording: Path, until_s: float | None = None) -> tuple[RunHistory, float]:
    """Return what a recording knows, and when it began, seconds since 1970-01-01 UTC.

    Raises:
        click.UsageError: it cannot be used, or a rover is named, too.
    """
    if click.get_current_context().get_parameter_source("to") is ParameterSource.COMMANDLINE:
        raise click.UsageError("--file is of a recording, --to of a rover: choose one")
    from adapters.recording import RecordingError, read_history

    try:
        return read_history(recording, until_s)
    except RecordingError as error:
        raise click.UsageError(str(error)) from error


def since_began(began_utc_s: float) -> Callable[[float], str]:
    """Return what tells a time aboard as seconds since the beginning of a recording."""
    return lambda utc_s: f"{utc_s - began_utc_s:7.2f} s"


def date_and_time(utc_s: float) -> str:
    """Tell a time aboard by UTC, to hundredths of a second."""
    at = datetime.fromtimestamp(utc_s, UTC)
    return f"{at:%Y-%m-%d %H:%M:%S}.{at.microsecond // 10_000:02d}"


async def ask(
    client: "MrsClient", command: str | None = None, *, everything: bool = False
) -> RunHistory:
    """Return what a rover knows, as `MrsClient.get_history` does.

    An orbiter of a relay has no more than the reports that it heard, all of which are returned, or
    those of the command.

    Raises:
        UsageError: no command can be called so.
    """
    from adapters.mrs.spec import AreaError

    try:
        return await client.get_history(command, everything=everything)
    except UnknownCommandError as error:
        raise click.UsageError(str(error)) from error
    except MalError as error:
        if error.number != AreaError.NOT_SUPPORTED.value:
            raise
        number = None if command is None else int(command.rpartition(":")[2])
        return await _of_reports(client, number)


async def _of_reports(client: "MrsClient", number: int | None) -> RunHistory:
    """Return the history by reports alone, of the commands of a number or of all."""
    from adapters.mrs.spec import report_of

    found = map(report_of, await client.get_all_notifications(command_id=number))
    reports = sorted(found, key=lambda each: each.sequence)
    return RunHistory(reports[-1].utc_s if reports else 0.0, tuple(reports))
