"""Preview of a motion or a plan: the same tree and control laws on a copy of the rover."""

from executive.preview.predictions import Predictor as Predictor
from executive.preview.preview import MAX_POSES as MAX_POSES
from executive.preview.preview import Preview as Preview
from executive.preview.preview import PreviewRun as PreviewRun
from executive.preview.preview import StepPreview as StepPreview
from executive.preview.preview import TimedPose as TimedPose
from executive.preview.preview_rover import DelegatedMotionBase as DelegatedMotionBase
from executive.preview.preview_rover import KinematicBase as KinematicBase
