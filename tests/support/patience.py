"""A configuration for rovers that are played by real processes, on machines that are slow or stall.

What asks of the machine that it is on time is made to bear delays of seconds: ages, rates, and what
compares the present with what was commanded a moment ago. Tests in lock step, where no machine is
late, hold the executive to the values of the product.
"""

import re
import shutil
import subprocess
from pathlib import Path
from typing import Final

from executive.settings import names_in

CONFIG: Final = Path(__file__).resolve().parents[2] / "config"
"""The configuration of the product."""
STALE: Final = "odometry_stale: {above: 10}"
UNTIMED: Final = (
    "odometry_lags_sensors", "odometry_late", "odometry_rate_low", "odometry_frozen", "off_command",
    "turn_off_command", "turn_angle_off_command", "no_progress", "uncommanded_travel",
    "uncommanded_turn",
    "wheels_off_command", "wheel_travel_off_command", "wheels_unpowered", "motion_blocked",
)  # fmt: skip
"""Faults that a process which gets no processor shows, though nothing is wrong with the rover."""
BY_ARRIVAL: Final = {
    "mocup": (
        "odometry_off_twist",
        "odometry_heading_off_twist",
        "odometry_jumped",
        "odometry_heading_jumped",
    )
}
"""What is shown, too, by a rover whose odometry is stamped when it comes."""


def shipped(folder: Path = CONFIG) -> list[Path]:
    """Return the files below a folder of the product that git tracks; all of them without git.

    What users keep beside them, such as assets of their own, is theirs.
    """
    below = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    if shutil.which("git") is None:
        return below
    command = ["git", "ls-files", "-z"]
    found = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    tracked = {folder / name for name in found.stdout.split("\0")}
    return [path for path in below if path in tracked] if found.returncode == 0 else below


def shipped_names(folder: Path = CONFIG) -> list[str]:
    """Return the names of the YAML files in a folder of the product, of those that git tracks."""
    tracked = {path.stem for path in shipped(folder) if path.parent == folder}
    return [name for name in names_in(folder) if name in tracked]


def shipped_config(folder: Path, source: Path = CONFIG) -> Path:
    """Copy the configuration as it is shipped, and return the copy."""
    for path in shipped(source):
        copy = folder / "config" / path.relative_to(source)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(path, copy)
    return folder / "config"


def patient_config(folder: Path, source: Path = CONFIG) -> Path:
    """Copy the configuration, make its assets patient, and return the copy."""
    copy = shipped_config(folder, source)
    for name in names_in(copy):
        path = copy / f"{name}.yaml"
        path.write_text(_patient(path.read_text(), UNTIMED + BY_ARRIVAL.get(name, ())))
    return copy


def _patient(asset: str, untimed: tuple[str, ...]) -> str:
    rows = [STALE, *(f"{name}: {{reaction: ignore}}" for name in untimed)]
    for row in rows:
        asset = re.sub(rf"(?m)^  {row.partition(':')[0]}:.*\n", "", asset)
    instead = {
        "faults:": "\n  ".join(["faults:", *rows]),
        "  watchdog_s: .*": "  watchdog_s: 30",
        "  capture_deadline_s: .*": "  capture_deadline_s: 30",
    }
    for usual, patient in instead.items():
        asset, found = re.subn(f"(?m)^{usual}$", patient, asset)
        assert found == 1, f"no {usual} in an asset"
    return asset
