"""An emulated LEGO NXT brick, and the USB cable on which rover-nxt finds it."""

from sim.brick.firmware import Firmware, Readings
from sim.brick.machine import Senses, SetPoints
from sim.brick.plug import UsbPlug
from sim.brick.settings import BrickSettings

__all__ = ["BrickSettings", "Firmware", "Readings", "Senses", "SetPoints", "UsbPlug"]
