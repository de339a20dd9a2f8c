"""The process `rover-mops`: its command line. `relay` serves the MRS for the rovers."""

import asyncio
from pathlib import Path
from typing import Final

import click

from adapters.mrs.cli import add_terms_options
from adapters.mrs.transport import TransportSettings
from adapters.process import (
    data_option,
    default_folder,
    log_level_option,
    metrics_option,
    process,
)

FOLDER: Final = "orbiter"


@process("rover-mops", ros=False)
@click.option(
    "--config",
    type=click.Path(path_type=Path),
    metavar="YAML",
    help="Node, rovers, contact plan.  [default: mops/orbiter.yaml in config/]",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address of the MRS.")
@add_terms_options("orbiter")
@metrics_option
@data_option("bundles and records", FOLDER)
@log_level_option
def main(
    config: Path | None,
    host: str,
    terms: TransportSettings,
    clear_text: bool,
    metrics: tuple[str, int] | None,
    data: Path | None,
) -> None:
    """Serve the MRS for rovers behind the relay until SIGINT or SIGTERM.

    Commands become MOPS strings in bundles, which wait for a contact. Messages of the rovers
    become notifications and telemetry. It prints an address for each rover, then logs
    one line an event. Nothing that was acknowledged is lost, however the process ends.

    \b
    Examples:
      rover-mops
      rover-mops --config relay.yaml --data relay1
      rover-mops --host 0.0.0.0 --certificate relay.pem --key relay.key --authorities ground.pem

    \b
    Exit status:
      0  ended by a signal; queued bundles are retained
      1  cannot start; the text gives the reason
      2  the command line or a settings file is invalid
    """
    from adapters.relay.orbiter.relay import serve
    from adapters.relay.orbiter.settings import load_orbiter
    from executive.settings import config_folder

    path = config or config_folder() / "mops" / "orbiter.yaml"
    folder = data or default_folder(FOLDER)
    asyncio.run(serve(load_orbiter(path), path, host, folder, clear_text, terms, metrics))


if __name__ == "__main__":
    main()
