"""Preview of a motion or a plan: the same tree and control laws on a copy of the rover."""

from executive.preview.copied_rover import KinematicBase as KinematicBase
from executive.preview.predictions import Predictor as Predictor
from executive.preview.preview import MOST_POSES as MOST_POSES
from executive.preview.preview import Preview as Preview
from executive.preview.preview import PreviewRun as PreviewRun
