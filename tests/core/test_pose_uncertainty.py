"""What a fault has shown of the pose stays in force: over motions, a resume, and a restart."""

from collections.abc import Iterator
from dataclasses import replace
from math import hypot
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executive.commands import (
    ConfirmPose,
    FollowPath,
    MoveForward,
    MoveTo,
    Request,
    Resume,
    RotateTo,
    SetPositionCompensation,
    Waypoint,
)
from executive.geometry import Pose, wrap_rad
from executive.reasons import Figure, Reason
from executive.reports import Report, Severity, Stage
from executive.settings import BatterySettings, Settings, load_settings
from executive.state import Battery
from executive.zones import KnownRock, Zones
from tests.core.test_second_odometry import SeeingBench, seen_from_elsewhere, with_second_odometry
from tests.support.kinematic import Bench

ABSOLUTE: tuple[Request, ...] = (
    MoveTo(Waypoint(1.0, 0.0, 0.0)),
    FollowPath((Waypoint(1.0, 0.0), Waypoint(2.0, 0.0))),
    RotateTo(0.5),
)


def moved(pose: Pose, x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0) -> Pose:
    return replace(
        pose,
        x_m=pose.x_m + x_m,
        y_m=pose.y_m + y_m,
        heading_rad=wrap_rad(pose.heading_rad + heading_rad),
    )


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    with Bench(tmp_path) as bench:
        bench.run(1.0)
        yield bench


def jump(bench: Bench, **by: float) -> None:
    """Let the odometry jump, and end what the executive does about it."""
    bench.rover.pose = moved(bench.rover.pose, **by)
    bench.run(0.5)
    bench.submit(Resume(), 90)
    assert bench.stages(90)[-1] is Stage.EXECUTED
    bench.run(0.5)


def figure(report: Report, name: str) -> float:
    return next(each.value for each in report.figures if each.name == name)
