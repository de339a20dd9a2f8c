"""`rover-executive`: the process aboard that takes commands and moves the rover."""

import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from adapters.mrs.terms_options import add_terms_options, terms_from_options
from adapters.onboard.lean import do_without_openssl
from adapters.process import (
    add_data,
    add_log_level,
    data_folder,
    existing_file,
    port,
    split_ros_arguments,
)

if TYPE_CHECKING:
    from adapters.mal import MalUri
    from executive.settings import Settings

FAILED: Final = 1

DESCRIPTION: Final = """\
Run the executive of an asset until SIGINT or SIGTERM.

It prints the address of its MRS link, then logs one line an event. On the way out the rover
stands, and what was under way ends CANCELLED. What follows --ros-args goes to ROS.
"""

EPILOG: Final = """\
examples:
  rover-executive
  rover-executive --port 0 --data rover1
  rover-executive --host 0.0.0.0 --certificate rover.pem --key rover.key --authorities ground.pem
  rover-executive --video-to 192.0.2.7:5006
  rover-executive --asset scout --port 41001 --service-layer 127.0.0.1:41000
  rover-executive --ros-args -p use_sim_time:=true -r __ns:=/rover1

exit status:
  0  ended by a signal, the rover standing
  1  cannot start; the text says why
  2  the command line or a settings file makes no sense
"""


def parser() -> ArgumentParser:
    """Return the command line. Not by click: it would stay in memory for as long as this runs."""
    found = ArgumentParser(
        "rover-executive",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=RawDescriptionHelpFormatter,
    )
    found.add_argument("--asset", default="jackal", help="asset name, or its YAML file [jackal]")
    found.add_argument("--host", default="127.0.0.1", help="address of the MRS link [127.0.0.1]")
    found.add_argument(
        "--port",
        type=port,
        default=41000,
        help="TCP port of the MRS link; 0 takes a free one, which is printed [41000]",
    )
    add_terms_options(found, "rover")
    for name, meaning in (("from", "where sources send it"), ("to", "where it goes on to")):
        found.add_argument(
            f"--video-{name}",
            type=_udp_address,
            metavar="HOST:PORT",
            help=f"video stream: {meaning}, over UDP [section video of the asset]",
        )
    found.add_argument(
        "--service-layer",
        metavar="URI",
        help="MRS link of another rover, to register at: each then hears the other [none]",
    )
    found.add_argument(
        "--relay",
        action="store_true",
        help="serve the relay link too: MOPS strings on ROS topics, to and from rover-relay",
    )
    add_data(found, "ledger and files")
    found.add_argument(
        "--ros-params", type=existing_file, help="ROS parameter file [ASSET.ros.yaml in config/]"
    )
    add_log_level(found)
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the executive.

    Args:
        arguments: the command line; None takes the process's own.
    """
    own, ros = split_ros_arguments(sys.argv[1:] if arguments is None else arguments)
    line = parser()
    _serve(line, line.parse_args(own), tuple(ros))


def _serve(line: ArgumentParser, options: Namespace, ros: tuple[str, ...]) -> None:
    from adapters.process.packages import NoRosError, require_ros

    try:
        require_ros()
    except NoRosError as error:
        sys.exit(f"Error: {error}")
    terms = terms_from_options(line, options)
    if terms.certificates is None:
        do_without_openssl()
    from adapters.onboard.service import Options, StartError, serve
    from adapters.process import log_to_stderr
    from adapters.ros import ParameterError
    from executive.settings import SettingsError, config_folder, load_settings

    try:
        settings = _with_video(line, load_settings(options.asset), options)
        data = data_folder(options, settings.asset)
        parameters = options.ros_params or config_folder() / f"{settings.asset}.ros.yaml"
        log_to_stderr(options.log_level)
        address = (options.host, options.port)
        in_clear, above = options.clear_text, _service_layer(line, options)
        serve(
            Options(
                settings, *address, data, parameters, ros, in_clear, terms, above, options.relay
            )
        )
    except (SettingsError, ParameterError) as error:
        line.error(str(error))
    except StartError as error:
        print(f"Error: {error}", file=sys.stderr)
        sys.exit(FAILED)


def _service_layer(line: ArgumentParser, options: Namespace) -> "MalUri | None":
    if options.service_layer is None:
        return None
    from adapters.mrs.ground import parse_address

    try:
        return parse_address(options.service_layer)
    except ValueError as error:
        line.error(f"argument --service-layer: {error}")


def _with_video(line: ArgumentParser, settings: "Settings", options: Namespace) -> "Settings":
    """Return the settings with the addresses of the video stream that the command line gives."""
    found = {}
    if options.video_from is not None:
        found["listen_host"], found["listen_port"] = options.video_from
    if options.video_to is not None:
        found["to_host"], found["to_port"] = options.video_to
    if not found:
        return settings
    if settings.video is None:
        line.error(f"{settings.asset} has no video: its settings have no section video")
    return replace(settings, video=replace(settings.video, **found))


def _udp_address(text: str) -> tuple[str, int]:
    from adapters.video import parse_address

    try:
        return parse_address(text)
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    main()
