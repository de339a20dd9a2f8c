"""An emulated LEGO NXT brick, and its emulated USB cable to rover-nxt."""

from sim.brick.firmware import Firmware as Firmware
from sim.brick.firmware import Readings as Readings
from sim.brick.machine import SensorReadings as SensorReadings
from sim.brick.machine import SetPoints as SetPoints
from sim.brick.motion import BrickSettings as BrickSettings
from sim.brick.plug import UsbPlug as UsbPlug
