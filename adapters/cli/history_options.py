"""What `rover log` and `rover why` share: where the history comes from, and its times."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import click

from adapters.explanation import Chronicle

file_option: Final = click.option(
    "--file",
    "recording",
    metavar="RUN.mcap",
    required=True,
    type=click.Path(path_type=Path),
    help="A recorded run.",
)


def read_file(recording: Path, until_s: float | None = None) -> tuple[Chronicle, float]:
    """Return what a recording knows, and when it began, seconds since 1970-01-01 UTC.

    Raises:
        click.UsageError: it cannot be used.
    """
    from adapters.recording import RecordingError, read_chronicle

    try:
        return read_chronicle(recording, until_s)
    except RecordingError as error:
        raise click.UsageError(str(error)) from error


def since_began(began_utc_s: float) -> Callable[[float], str]:
    """Return what tells a time aboard as seconds since the beginning of a recording."""
    return lambda utc_s: f"{utc_s - began_utc_s:7.2f} s"
