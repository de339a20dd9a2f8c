"""`rover-mops`: the process at the orbiter that serves the MRS for the rovers behind it."""

import asyncio
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from adapters.mrs.terms_options import add_terms_options, terms_from_options
from adapters.process import add_data, add_log_level, data_folder, log_to_stderr

FOLDER: Final = "orbiter"

DESCRIPTION: Final = """\
Serve the MRS for rovers behind the relay until SIGINT or SIGTERM.

Commands become MOPS strings in bundles, which wait here until there is contact; what the rovers
say comes back as notifications and telemetry. It prints an address for each rover, then logs one
line an event. Nothing that was acknowledged is lost, however it ends.
"""

EPILOG: Final = """\
examples:
  rover-mops
  rover-mops --config relay.yaml --data relay1
  rover-mops --host 0.0.0.0 --certificate relay.pem --key relay.key --authorities ground.pem

exit status:
  0  ended by a signal; what waits goes on waiting
  1  cannot start; the text says why
  2  the command line or a settings file makes no sense
"""


def parser() -> ArgumentParser:
    """Return the command line."""
    found = ArgumentParser(
        "rover-mops",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    found.add_argument(
        "--config",
        type=Path,
        metavar="YAML",
        help="node, rovers, contact plan [mops/orbiter.yaml in config/]",
    )
    found.add_argument("--host", default="127.0.0.1", help="address of the MRS [127.0.0.1]")
    add_terms_options(found, "orbiter")
    add_data(found, "bundles and records", FOLDER)
    add_log_level(found)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the relay.

    Args:
        arguments: the command line; None takes the process's own.
    """
    from adapters.relay.orbiter.service import Options, StartError, serve
    from adapters.relay.orbiter.settings import load_orbiter
    from executive.settings import SettingsError, config_folder

    line = parser()
    options = line.parse_args(arguments)
    terms = terms_from_options(line, options)
    path = options.config or config_folder() / "mops" / "orbiter.yaml"
    log_to_stderr(options.log_level)
    data = data_folder(options, FOLDER)
    try:
        settings = load_orbiter(path)
        asyncio.run(serve(Options(settings, path, options.host, data, options.clear_text, terms)))
    except SettingsError as error:
        line.error(str(error))
    except StartError as error:
        sys.exit(f"Error: {error}")


if __name__ == "__main__":
    main()
