"""An asset's file holds what its keys mean, or one error names file, key and what is allowed."""

from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any

import pytest
import yaml

from executive.settings import Settings, SettingsError, config_folder, load_settings


def changed(folder: Path, key: str, value: object) -> Settings:
    """Return the Jackal's settings with another value at a dotted key of its file."""
    raw = yaml.safe_load((config_folder() / "jackal.yaml").read_text(encoding="utf-8"))
    *sections, last = key.split(".")
    section: dict[str, Any] = raw
    for name in sections:
        section = section[name]
    section[last] = value
    path = folder / "mine.yaml"
    path.write_text(yaml.safe_dump(raw), encoding="utf-8")
    return load_settings(str(path))


@pytest.mark.parametrize(
    ("key", "value", "fault"),
    [
        ("recording.enabled", "no", "expected true or false, got 'no'"),
        ("drive.queue_length", 5.7, "expected a whole number, got 5.7"),
        ("drive.queue_length", True, "expected a whole number, got True"),
        ("drive.distance_m", True, "expected a number, got True"),
        ("drive.distance_m", float("nan"), "expected a finite number, got nan"),
        ("asset", 7, "expected a text, got 7"),
        ("camera.formats", "JPG", "expected a list, got 'JPG'"),
        ("camera.pan_min_rad", "left", "expected a number (radians, or degrees as 90deg)"),
        ("mux.topics", 5, "expected keys and values, got 5"),
        ("mux", 5, "expected keys and values, got 5"),
        ("controller", "TURN_DRIVE", "'TURN_DRIVE' is none of turn_drive, mpc, navigation"),
    ],
)
def test_a_value_of_the_wrong_kind_is_refused(
    tmp_path: Path, key: str, value: object, fault: str
) -> None:
    with pytest.raises(SettingsError) as caught:
        changed(tmp_path, key, value)
    assert str(caught.value).startswith(f"{tmp_path / 'mine.yaml'}: {key}: {fault}")


def test_several_faults_are_one_error(tmp_path: Path) -> None:
    with pytest.raises(SettingsError) as caught:
        changed(tmp_path, "safety", {"watchdog": 1, "watchdogs": 2})
    assert str(caught.value).endswith(
        "safety: unknown key 'watchdog' (did you mean watchdog_s?), 'watchdogs' (did you mean"
        " watchdog_s?); known are watchdog_s"
    )


def test_each_fault_has_its_own_line(tmp_path: Path) -> None:
    with pytest.raises(SettingsError) as caught:
        changed(tmp_path, "safety", {"watchdog_s": "1 mile", "watchdogs": 2})
    first, *faults = str(caught.value).splitlines()
    assert first.endswith("mine.yaml:")
    assert faults == [
        "  safety.watchdog_s: '1 mile' is no quantity in s: write 10, 10s or 2min",
        "  safety: unknown key 'watchdogs' (did you mean watchdog_s?); known are watchdog_s",
    ]


def test_an_angle_may_be_in_degrees(tmp_path: Path) -> None:
    settings = changed(tmp_path, "camera.pan_min_rad", "-90deg")
    usual = load_settings("jackal")
    assert settings == replace(usual, camera=replace(usual.camera, pan_min_rad=radians(-90)))
