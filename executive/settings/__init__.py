"""Settings of an asset, read from its YAML and validated as a whole.

The sections `faults:` and `zones:` belong to `executive.faults` and `executive.obstacles.zones`.
"""

from executive.settings.asset_settings import MAX_PORT as MAX_PORT
from executive.settings.asset_settings import MIN_REPORTS as MIN_REPORTS
from executive.settings.asset_settings import AuthoritySettings as AuthoritySettings
from executive.settings.asset_settings import DriveLimits as DriveLimits
from executive.settings.asset_settings import ImuSettings as ImuSettings
from executive.settings.asset_settings import JointsSettings as JointsSettings
from executive.settings.asset_settings import LaserSettings as LaserSettings
from executive.settings.asset_settings import LinkLossAction as LinkLossAction
from executive.settings.asset_settings import LinkLossSettings as LinkLossSettings
from executive.settings.asset_settings import LinkLossStage as LinkLossStage
from executive.settings.asset_settings import LocomotionKind as LocomotionKind
from executive.settings.asset_settings import MuxEntry as MuxEntry
from executive.settings.asset_settings import MuxSettings as MuxSettings
from executive.settings.asset_settings import RecordingSettings as RecordingSettings
from executive.settings.asset_settings import SecondOdometrySettings as SecondOdometrySettings
from executive.settings.asset_settings import Sensor as Sensor
from executive.settings.asset_settings import Sensors as Sensors
from executive.settings.asset_settings import Settings as Settings
from executive.settings.asset_settings import SpeedProfileKind as SpeedProfileKind
from executive.settings.asset_settings import TurnDriveSettings as TurnDriveSettings
from executive.settings.asset_settings import VideoSettings as VideoSettings
from executive.settings.asset_settings import load_settings as load_settings
from executive.settings.controller import Controller as Controller
from executive.settings.fault_rows import settings_reader as settings_reader
from executive.settings.mpc_settings import MpcSettings as MpcSettings
from executive.settings.mpc_settings import SlipSettings as SlipSettings
from executive.settings.mpc_settings import YawResponse as YawResponse
from executive.settings.prediction_settings import BatterySettings as BatterySettings
from executive.settings.prediction_settings import MotionEndKind as MotionEndKind
from executive.settings.prediction_settings import MotionExtent as MotionExtent
from executive.settings.prediction_settings import PredictionSettings as PredictionSettings
from executive.settings.prediction_settings import curved_m as curved_m
from executive.settings.settings_files import SettingsError as SettingsError
from executive.settings.settings_files import config_folder as config_folder
from executive.settings.settings_files import faults_of as faults_of
from executive.settings.settings_files import load_yaml as load_yaml
from executive.settings.settings_files import named_file as named_file
from executive.settings.settings_files import names_in as names_in
from executive.settings.settings_files import parse_yaml as parse_yaml
from executive.settings.settings_files import read_yaml as read_yaml
from executive.settings.settings_files import require_above_zero as require_above_zero
from executive.settings.settings_files import structure as structure
from executive.settings.settings_files import unstructure as unstructure
from executive.settings.strict_reader import FormatError as FormatError
from executive.settings.strict_reader import StrictReader as StrictReader
from executive.settings.strict_reader import angle as angle
from executive.settings.strict_reader import angle_of as angle_of
from executive.settings.strict_reader import figure as figure
from executive.settings.strict_reader import hint as hint
from executive.settings.strict_reader import in_degrees as in_degrees
from executive.settings.strict_reader import shown as shown
