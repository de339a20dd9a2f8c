"""Shared by `rover log` and `rover why`: reads the history from a file or by MRS, formats times."""

from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click
from click.core import ParameterSource

from adapters.explanation import UnknownCommandError
from adapters.mal import MalError
from executive.history import RunHistory
from executive.values.quantities import QuantityError, read_quantity

if TYPE_CHECKING:
    from adapters.mrs.ground import MrsClient


file_option: Final = click.option(
    "--file",
    "recording",
    metavar="RUN.mcap",
    type=click.Path(path_type=Path),
    help="Read a recorded run instead of the rover.",
)


Moment = float | datetime
"""Seconds before now, or after the start of a recording; or a time."""


class MomentType(click.ParamType[Moment]):
    """A duration, such as 10min; today, yesterday; or a time of ISO 8601, in UTC unless given."""

    name = "TIME"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> Moment:
        """Return a duration in seconds, or a time."""
        today = datetime.now(UTC).replace(hour=0, minute=0, second=0, microsecond=0)
        days = {"today": today, "yesterday": today - timedelta(days=1)}
        if (day := days.get(value)) is not None:
            return day
        with suppress(QuantityError):
            return read_quantity(value, "s", comma=True)
        try:
            time = datetime.fromisoformat(value)
        except ValueError:
            forms = "write 90, 10min, today, yesterday or 2026-05-04T10:30"
            self.fail(f"{value!r} is no time: {forms}", param, ctx)
        return time if time.tzinfo is not None else time.replace(tzinfo=UTC)


def utc_of(moment: Moment | None, origin_utc_s: float, sign: float) -> float | None:
    """Return a UTC time in seconds; a duration counts from an origin, before it if negative."""
    if isinstance(moment, datetime):
        return moment.timestamp()
    return None if moment is None else origin_utc_s + sign * moment


def read_file(recording: Path, until_s: float | None = None) -> tuple[RunHistory, float]:
    """Return the history of a recording, and its start in seconds since 1970-01-01 UTC.

    Raises:
        click.UsageError: the file cannot be used, or a rover is given, too.
    """
    if click.get_current_context().get_parameter_source("to") is ParameterSource.COMMANDLINE:
        raise click.UsageError("--file selects a recording, --to a rover: choose one")
    from adapters.recording import RecordingError, read_history

    try:
        return read_history(recording, until_s)
    except RecordingError as error:
        raise click.UsageError(str(error)) from error


def since_began(began_utc_s: float) -> Callable[[float], str]:
    """Return a formatter of on-board times as seconds since the start of a recording."""
    return lambda utc_s: f"{utc_s - began_utc_s:7.2f} s"


def date_and_time(utc_s: float) -> str:
    """Return an on-board time as date and time in UTC, to hundredths of a second."""
    at = datetime.fromtimestamp(utc_s, UTC)
    return f"{at:%Y-%m-%d %H:%M:%S}.{at.microsecond // 10_000:02d}"


async def query_history(
    client: "MrsClient", command: str | None = None, *, everything: bool = False
) -> RunHistory:
    """Return the history of a rover, as `MrsClient.get_history` does.

    An orbiter of a relay has only the received reports: all, or those of the command, are
    returned.

    Raises:
        UsageError: the text is no command id.
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
    """Return a history of reports only, of all commands with a number or of all."""
    found = await client.get_all_notifications(command_id=number)
    reports = sorted((each.report for each in found), key=lambda each: each.sequence)
    return RunHistory(reports[-1].utc_s if reports else 0.0, tuple(reports))
