"""How a rover answers to commands, fitted to a recording of a drive.

    settings ─> pattern ─> a plan, driven and recorded ─> drive_log ─> fit ─> asset_file ─> YAML

The laws are those of `executive.settings.mpc_settings`. Needs NumPy and SciPy (the extra `sim`).
docs/controllers.md shows its use.
"""

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
