"""rover-nxt with a simulated brick: `python -m sim.brick.nxt --usb-socket PATH`."""

import sys
from pathlib import Path

from adapters.mocup.brick.process import parser, run
from adapters.process.options import split_ros_arguments


def main() -> None:
    """Run rover-nxt on the bus of a socket."""
    own, ros = split_ros_arguments(sys.argv[1:])
    line = parser("python -m sim.brick.nxt")
    line.add_argument(
        "--usb-socket", type=Path, required=True, metavar="PATH", help="where the brick is plugged"
    )
    options = line.parse_args(own)
    from sim.brick.backend import SocketBackend

    run(line, own, ros, SocketBackend(options.usb_socket))


if __name__ == "__main__":
    main()
