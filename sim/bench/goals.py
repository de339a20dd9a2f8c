"""Files of pose-to-pose goals with their best known times."""

import json
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Any, Final

from executive.settings import SettingsError, structure

OWN_GOALS: Final = Path(__file__).with_name("goals.json")


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """The limits under which the best known times were found."""

    travel_speed_mps: float
    rotate_speed_radps: float
    travel_acceleration_mps2: float
    rotate_acceleration_radps2: float


@dataclass(frozen=True, slots=True)
class DriveGoal:
    """A pose to reach from the origin, from rest to rest."""

    id: str
    x_m: float
    y_m: float
    heading_rad: float
    best_known_time_s: float


@dataclass(frozen=True, slots=True)
class Goals:
    """What a goals file holds."""

    limits: MotionLimits
    goals: tuple[DriveGoal, ...]


def read_goals(path: Path) -> Goals:
    """Return the goals of a file.

    Raises:
        SettingsError: the file cannot be read, is no JSON, or lacks a goal's figures.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise SettingsError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise SettingsError(f"{path}: is not JSON ({error})") from error
    if not isinstance(raw, dict):
        raise SettingsError(f"{path}: must be an object with limits and goals")
    rows = raw.get("goals")
    if not isinstance(rows, list) or not rows:
        raise SettingsError(f"{path}: goals must be a list of one goal at least")
    known = {"limits": raw.get("limits"), "goals": [_only_known(row) for row in rows]}
    goals = structure(known, Goals, str(path))
    for name in MotionLimits.__slots__:
        if not 0.0 < getattr(goals.limits, name) < inf:
            raise SettingsError(f"{path}: limits.{name} must be above 0")
    for goal in goals.goals:
        figures = (goal.x_m, goal.y_m, goal.heading_rad, goal.best_known_time_s)
        if not all(isfinite(figure) for figure in figures) or goal.best_known_time_s <= 0:
            raise SettingsError(f"{path}: goal {goal.id} has a figure that cannot be")
    return goals


def _only_known(row: Any) -> Any:
    fields = DriveGoal.__slots__
    return {k: v for k, v in row.items() if k in fields} if isinstance(row, dict) else row
