"""Where a motion or a plan would lead: the same tree and motion laws on a copy of the rover."""

from executive.preview.copied_rover import KinematicBase
from executive.preview.predictions import Predictions
from executive.preview.preview import MOST_POSES, Preview, PreviewRun

__all__ = [
    "MOST_POSES",
    "KinematicBase",
    "Predictions",
    "Preview",
    "PreviewRun",
]
