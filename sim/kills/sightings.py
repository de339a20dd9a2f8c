"""Where the rover truly was, as lines of a log."""

import time
from dataclasses import dataclass
from pathlib import Path

from executive.geometry import Pose


@dataclass(frozen=True, slots=True)
class Sighting:
    """Where base_link was at a time of this computer's clock, UTC."""

    utc_s: float
    x_m: float
    y_m: float
    heading_rad: float


def line_of(pose: Pose) -> str:
    """Return the line that tells a pose that is seen now."""
    return f"{time.time():.4f} {pose.x_m:.5f} {pose.y_m:.5f} {pose.heading_rad:.5f}"


def read_sightings(path: Path) -> list[Sighting]:
    """Return what a log of such lines tells, but for a last one that is not whole."""
    lines = path.read_text(encoding="utf-8").split("\n")[:-1]
    return [Sighting(*map(float, line.split())) for line in lines]
