"""A configuration for rovers that are played by real processes, on machines that are slow or stall.

What asks of the machine that it is on time is made to bear delays of seconds: ages, rates, and what
compares the present with what was commanded a moment ago. Tests in lock step, where no machine is
late, hold the executive to the values of the product.
"""

import re
import shutil
from pathlib import Path
from typing import Final

from executive.settings import names_in

CONFIG: Final = Path(__file__).resolve().parents[2] / "config"
"""The configuration of the product."""
STALE: Final = "odometry_stale: {beyond: 10}"
UNTIMED: Final = (
    "odometry_behind", "odometry_late", "odometry_slow", "odometry_frozen", "off_command",
    "turn_off_command", "turn_amiss", "no_progress", "drives_uncommanded", "turns_uncommanded",
    "wheels_off_command", "wheels_off_command_slowly", "wheels_unpowered", "blocked",
)  # fmt: skip
"""Faults that a process which gets no processor shows, though nothing is wrong with the rover."""
BY_ARRIVAL: Final = {
    "mocup": (
        "odometry_off_twist",
        "odometry_heading_off_twist",
        "odometry_jumped",
        "odometry_turned",
    )
}
"""What is shown, too, by a rover whose odometry is stamped when it comes."""


def patient_config(folder: Path) -> Path:
    """Copy the configuration, make its assets patient, and return the copy."""
    copy = folder / "config"
    shutil.copytree(CONFIG, copy)
    for name in names_in(copy):
        path = copy / f"{name}.yaml"
        path.write_text(_patient(path.read_text(), UNTIMED + BY_ARRIVAL.get(name, ())))
    return copy


def _patient(asset: str, untimed: tuple[str, ...]) -> str:
    rows = [STALE, *(f"{name}: {{then: ignore}}" for name in untimed)]
    for row in rows:
        asset = re.sub(rf"(?m)^  {row.partition(':')[0]}:.*\n", "", asset)
    instead = {
        "faults:": "\n  ".join(["faults:", *rows]),
        "  watchdog_s: .*": "  watchdog_s: 30",
        "  capture_deadline_s: .*": "  capture_deadline_s: 30",
    }
    for said, patient in instead.items():
        asset, found = re.subn(f"(?m)^{said}$", patient, asset)
        assert found == 1, f"no {said} in an asset"
    return asset
