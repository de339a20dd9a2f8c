"""A simulated rover's brick on a cable: what the host writes and what the brick says."""

import logging
from pathlib import Path
from typing import Final

from sim.brick.plug import UsbPlug
from sim.mocup import SimulatedMocup

_LOG: Final = logging.getLogger(__name__)


class BrickOnUsb:
    """Carries octets between a brick and its host. One that is unplugged gives up what it does.

    Args:
        rover: whose brick it is.
        path: of the socket where a host finds it.
    """

    def __init__(self, rover: SimulatedMocup, path: Path) -> None:
        """Plug in.

        Raises:
            OSError: the socket cannot be made.
        """
        self._rover = rover
        self._plug = UsbPlug(path)
        self._connected = False

    def exchange(self) -> None:
        """Carry what waits, both ways. Never blocks; called once a period."""
        octets = self._plug.receive()
        if octets:
            self._rover.hear(octets)
        if self._connected and not self._plug.connected:
            self._rover.brick.unplug()
        if self._connected != self._plug.connected:
            self._connected = self._plug.connected
            _LOG.info("the brick is %s", "claimed" if self._connected else "let go")
        self._plug.send(self._rover.brick.give())

    def close(self) -> None:
        """Unplug."""
        self._plug.close()
