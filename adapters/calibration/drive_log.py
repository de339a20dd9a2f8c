"""The drive of a calibration: `plan_xml` plans it, `read_drive` reads its recording or bag."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from adapters.recording import RecordingError, RunReader
from executive.core.recording import (
    CoreCalled,
    FactObserved,
    HaltCommanded,
    ProcessStart,
    Truth,
    VelocityCommanded,
)
from executive.settings import DriveLimits, Settings
from executive.values.facts import Joints, Odometry, SecondOdometry
from executive.values.geometry import STANDING, Pose, Velocity

Series = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CommandSeries:
    """Commanded velocities, each with the time of its command."""

    time_s: Series
    travel_mps: Series
    rotate_radps: Series


@dataclass(frozen=True, slots=True)
class PoseSeries:
    """Poses over time; headings are not wrapped."""

    time_s: Series
    x_m: Series
    y_m: Series
    heading_rad: Series


@dataclass(frozen=True, slots=True)
class WheelSeries:
    """Mean rotation rate of the wheels of each side."""

    time_s: Series
    left_radps: Series
    right_radps: Series


@dataclass(frozen=True, slots=True)
class DriveLog:
    """A drive, on the clock of the executive.

    Attributes:
        odometry: poses by time of measurement; the velocities next to it have the same times.
        reference: true poses: ground truth of a simulation, else the second odometry; None
            without either.
        wheels: None if the rover does not measure them.
    """

    settings: Settings
    commands: CommandSeries
    odometry: PoseSeries
    travel_mps: Series
    rotate_radps: Series
    reference: PoseSeries | None
    wheels: WheelSeries | None


def read_drive(path: Path) -> DriveLog:
    """Return the drive in a recording; with several starts of the executive, the last one.

    Raises:
        RecordingError: the file is invalid, or has no drive of a velocity-controlled rover.
    """
    recording, drive = RunReader(path), _DriveLogReader()
    for message in recording.messages():
        drive.add_item(recording.decoded(message))
    return drive.log(path)


def drive_of(settings: Settings, arrived: Iterable[tuple[float, Any]], path: Path) -> DriveLog:
    """Return the drive in velocity commands (`Velocity`) and facts with their times of arrival, s.

    Raises:
        RecordingError: there is no drive; `path` names their file.
    """
    drive = _DriveLogReader(settings)
    for at_s, each in arrived:
        drive.add(at_s, each)
    return drive.log(path)


class _DriveLogReader:
    def __init__(self, settings: Settings | None = None) -> None:
        self._settings = settings
        self._begin()

    def _begin(self) -> None:
        self._now_s = 0.0
        self._drove: list[tuple[float, ...]] = []
        self._odometry: list[tuple[float, Odometry]] = []
        self._joints: list[Joints] = []
        self._second: list[tuple[float, Pose]] = []
        self._truth: list[tuple[float, Pose]] = []

    def add_item(self, item: Any) -> None:
        match item:
            case ProcessStart():
                self._settings = item.settings
                self._begin()
            case CoreCalled():
                self._now_s = item.now_s
            case FactObserved(now_s=now_s, fact=fact):
                self._now_s = now_s
                self.add(now_s, fact)
            case VelocityCommanded(velocity=velocity):
                self.add(self._now_s, velocity)
            case HaltCommanded():
                self.add(self._now_s, STANDING)
            case Truth():
                self._truth.append((item.time_s, item.pose))
            case _:
                pass

    def add(self, now_s: float, arrived: Any) -> None:
        match arrived:
            case Odometry():
                self._odometry.append((now_s, arrived))
            case SecondOdometry():
                self._second.append((arrived.stamp_s, arrived.pose))
            case Joints():
                self._joints.append(arrived)
            case Velocity():
                self._drove.append((now_s, arrived.travel_mps, arrived.rotate_radps))
            case _:
                pass

    def log(self, path: Path) -> DriveLog:
        # Drivers repeat stamps, and send late messages in another order.
        by_stamp = {fact.stamp_s: (now_s, fact) for now_s, fact in self._odometry}
        self._odometry = [by_stamp[stamp_s] for stamp_s in sorted(by_stamp)]
        if self._settings is None or not self._drove or len(self._odometry) < 2:
            raise RecordingError(f"{path}: has no drive of a velocity-controlled rover")
        stamps_s = np.array([fact.stamp_s for _, fact in self._odometry])
        arrived_s = np.array([now_s for now_s, _ in self._odometry])
        # The fastest message is assumed to have the latency in the settings.
        apart_s = float(np.min(arrived_s - stamps_s)) - self._settings.mpc.odometry_age_s
        measured = [(fact.stamp_s + apart_s, fact.pose) for _, fact in self._odometry]
        second = [(stamp_s + apart_s, pose) for stamp_s, pose in self._second]
        reference = self._truth or second
        velocities = [fact.velocity for _, fact in self._odometry]
        return DriveLog(
            self._settings,
            CommandSeries(*np.array(self._drove).T),
            _poses(measured),
            np.array([each.travel_mps for each in velocities]),
            np.array([each.rotate_radps for each in velocities]),
            _poses(reference) if len(reference) > 1 else None,
            self._wheels(apart_s),
        )

    def _wheels(self, apart_s: float) -> WheelSeries | None:
        measured = [each for each in self._joints if each.left_radps and each.right_radps]
        if not measured:
            return None
        rows = [
            (each.stamp_s + apart_s, np.mean(each.left_radps), np.mean(each.right_radps))
            for each in measured
        ]
        return WheelSeries(*np.array(rows).T)


def _poses(rows: list[tuple[float, Pose]]) -> PoseSeries:
    table = np.array([(time_s, pose.x_m, pose.y_m, pose.heading_rad) for time_s, pose in rows])
    return PoseSeries(table[:, 0], table[:, 1], table[:, 2], np.unwrap(table[:, 3]))


PATTERN: Final = (
    # Spins, lines, and arcs in both directions at several speeds, as (travel, rotate, seconds).
    *((0.0, rotate, 2.5) for rotate in (0.3, -0.7, 1.0, -1.0)),
    *((travel, 0.0, 2.0) for travel in (0.5, -0.5, 1.0, -1.0)),
    *(
        (direction * travel, rotate, 3.0)
        for travel, rotate in (
            *((0.3, 0.4), (0.3, -1.0), (0.6, 0.7), (0.6, -1.0)),
            *((1.0, 0.3), (1.0, -0.7), (1.0, 1.0), (1.0, -1.0)),
        )
        for direction in (1.0, -1.0)
    ),
)
"""Velocities as fractions of the asset's limits, with the duration of each."""
DEADLINE_S: Final = 15.0


def plan_xml(drive: DriveLimits) -> str:
    """Return the pattern as a plan for a rover with these limits.

    A drive that ends off target, as on a rover not yet calibrated, is also usable: the plan
    continues.
    """
    root = ElementTree.Element("root", BTCPP_format="4", main_tree_to_execute="Calibration")
    tree = ElementTree.SubElement(root, "BehaviorTree", ID="Calibration")
    sequence = ElementTree.SubElement(tree, "Sequence")
    for travel, rotate, duration_s in PATTERN:
        either = ElementTree.SubElement(sequence, "Fallback")
        ElementTree.SubElement(
            either,
            "drive",
            travel=f"{travel * drive.travel_speed_mps:g}",
            rotate=f"{rotate * drive.rotate_speed_radps:g}",
            duration=f"{duration_s:g}",
            deadline_s=f"{DEADLINE_S:g}",
        )
        ElementTree.SubElement(
            either,
            "setTravelSpeed",
            speed=f"{drive.travel_speed_mps:g}",
            deadline_s=f"{DEADLINE_S:g}",
        )
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
