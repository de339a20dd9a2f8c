"""How a rover answers to commands, found out from a recording of it driving about."""

from adapters.calibration.asset_file import with_figures
from adapters.calibration.drive_log import DriveLog, read_drive
from adapters.calibration.fit import Calibration, CalibrationError, Fitted, calibrate
from adapters.calibration.pattern import PATTERN, plan_xml

__all__ = [
    "PATTERN",
    "Calibration",
    "CalibrationError",
    "DriveLog",
    "Fitted",
    "calibrate",
    "plan_xml",
    "read_drive",
    "with_figures",
]
