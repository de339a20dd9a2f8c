"""Calibration of a rover's response to commands, fitted to a recorded drive.

    settings ─> pattern ─> a plan, driven and recorded ─> drive_log ─> fit ─> asset_file ─> YAML

The models are those of `executive.settings.mpc_settings`. Needs NumPy and SciPy (the extra `sim`).
docs/controllers.md shows its use.
"""

from adapters.calibration.asset_file import with_figures as with_figures
from adapters.calibration.drive_log import DriveLog as DriveLog
from adapters.calibration.drive_log import read_drive as read_drive
from adapters.calibration.fit import Calibration as Calibration
from adapters.calibration.fit import CalibrationError as CalibrationError
from adapters.calibration.fit import Fitted as Fitted
from adapters.calibration.fit import calibrate as calibrate
from adapters.calibration.pattern import plan_xml as plan_xml
