"""The cable between the emulated brick and its host: a local socket that keeps packets whole.

One message of the `SOCK_SEQPACKET` socket is one USB packet.
"""

import os
import socket
import tempfile
from pathlib import Path
from typing import Final

PACKET: Final = 64
"""Octets of a bulk packet."""


def cable() -> socket.socket:
    """Return an end that is not plugged in."""
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def default_path(asset: str) -> Path:
    """Return where the brick of an asset is found, by its host as by the simulation."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(folder) / f"rover-{asset}-{os.getuid()}.usb"
