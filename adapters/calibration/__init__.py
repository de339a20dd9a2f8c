"""Calibration: fits a rover's response to commands to a recorded drive, for its settings.

    settings ─> plan_xml, driven and recorded ─> drive_log ─> fit ─> figures of the YAML

The models are those of `executive.settings.mpc_settings`. Needs SciPy (the extra `campaign`).
docs/controllers.md shows its use.
"""

from adapters.calibration.drive_log import DriveLog as DriveLog
from adapters.calibration.drive_log import drive_of as drive_of
from adapters.calibration.drive_log import plan_xml as plan_xml
from adapters.calibration.drive_log import read_drive as read_drive
from adapters.calibration.fit import Calibration as Calibration
from adapters.calibration.fit import CalibrationError as CalibrationError
from adapters.calibration.fit import Fitted as Fitted
from adapters.calibration.fit import calibrate as calibrate
