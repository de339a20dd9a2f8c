"""The process `rover-console`: its command line. `service` serves the pages."""

import asyncio
import logging
from pathlib import Path
from typing import Final

import click

from adapters.console import PORT, PORT_VARIABLE
from adapters.console.archive import RetentionPolicy
from adapters.console.service import ConsoleOptions, serve
from adapters.mrs.cli import RoverTarget, to_options
from adapters.process import (
    EXISTING_FILE,
    PORT_NUMBER,
    data_option,
    default_folder,
    log_level_option,
    process,
)
from adapters.system import OPERATING_SYSTEM
from adapters.video import parse_address

FOLDER: Final = "console"


def _addresses(
    _: click.Context, __: click.Parameter, texts: tuple[str, ...]
) -> dict[str, tuple[str, int]]:
    try:
        pairs = [text.partition("=") for text in texts]
        return {asset: parse_address(address) for asset, _, address in pairs}
    except ValueError as error:
        raise click.BadParameter(f"{error}; write ASSET=HOST:PORT") from error


@process("rover-console", ros=False)
@to_options
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of the console.")
@click.option(
    "--port",
    type=PORT_NUMBER,
    envvar=PORT_VARIABLE,
    default=PORT,
    show_default=True,
    show_envvar=True,
    help="TCP port of the console; 0 takes a free one, which is printed.",
)
@click.option(
    "--video",
    multiple=True,
    callback=_addresses,
    metavar="ASSET=HOST:PORT",
    help="Where an asset's video arrives, by UDP.  [default: section video of the asset]",
)
@click.option(
    "--tokens",
    type=EXISTING_FILE,
    metavar="FILE",
    help="Operators who may log in: lines NAME TOKEN. Needed if other hosts reach the console.",
)
@click.option(
    "--tls-certificate",
    type=EXISTING_FILE,
    metavar="PEM",
    help="HTTPS: certificate of the console. Needed if other hosts reach it.",
)
@click.option("--tls-key", type=EXISTING_FILE, metavar="PEM", help="HTTPS: its private key.")
@click.option(
    "--recording",
    "recordings",
    multiple=True,
    type=EXISTING_FILE,
    metavar="MCAP",
    help="Recording of a rover to open beside the rovers; may be repeated.",
)
@data_option("the archive", FOLDER)
@click.option(
    "--archive",
    metavar="URL",
    help="Database of the archive: sqlite:///FILE or postgresql://USER@HOST/DATABASE.  [default:"
    " archive.sqlite in --data]",
)
@click.option(
    "--max-days",
    type=click.FloatRange(min=0.0, min_open=True),
    default=30.0,
    show_default=True,
    help="Maximum age of archived data, in days.",
)
@click.option(
    "--max-mb",
    type=click.FloatRange(min=1.0),
    default=2000.0,
    show_default=True,
    help="Maximum size of archived data, in MB; old data is deleted first.",
)
@log_level_option
def main(
    to: tuple[RoverTarget, ...],
    host: str,
    port: int,
    video: dict[str, tuple[str, int]],
    tokens: Path | None,
    tls_certificate: Path | None,
    tls_key: Path | None,
    recordings: tuple[Path, ...],
    data: Path | None,
    archive: str | None,
    max_days: float,
    max_mb: float,
) -> None:
    """Serve the operations console until SIGINT or SIGTERM.

    It prints its address for a browser, then logs one line for each event. It is an MRS client of
    the rovers, reconnects by itself, and finds the assets that are registered at them.

    \b
    Examples:
      rover-console
      rover-console --to rover.local:21000 --to 192.0.2.7:21001
      rover-console --recording 20261124T000945Z.mcap
      rover-console --host 0.0.0.0 --tokens operators.txt --tls-certificate console.pem \\
          --tls-key console.key

    \b
    Exit status:
      0  ended by a signal
      1  cannot start; the text gives the reason
      2  invalid command line
    """
    if (tls_certificate is None) != (tls_key is None):
        raise click.UsageError("HTTPS needs both: --tls-certificate and --tls-key")
    logging.getLogger("executive").setLevel(logging.WARNING)  # the twins' copies, no rover
    tls = None if tls_certificate is None or tls_key is None else (tls_certificate, tls_key)
    retention = RetentionPolicy(max_days, max_mb)
    folder = data or default_folder(FOLDER)
    options = ConsoleOptions(
        to, host, port, tokens, tls, folder, archive, retention, video, recordings
    )
    asyncio.run(serve(options, OPERATING_SYSTEM))


if __name__ == "__main__":
    main()
