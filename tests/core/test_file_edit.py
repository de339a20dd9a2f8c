"""New values in the YAML files of an asset: nothing else in them changes."""

from pathlib import Path

import pytest

from executive.settings import (
    SettingsError,
    edit_file,
    installed_warning,
    load_settings,
    with_values,
    write_edits,
)
from tests.suite import CHECKOUT

YAML = """\
# about
mpc:  # of it
  delay: 0.05 # s
  slip: {offset: 1, gain: 2}
  none: {}
last: 3
"""


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ({"mpc.delay": 0.06}, YAML.replace("0.05", "0.06")),
        ({"mpc.slip.gain": 2.5}, YAML.replace("2}", "2.5}")),
        ({"mpc.slip.lag": 0.1}, YAML.replace("2}", "2, lag: 0.1}")),
        ({"mpc.none.lag": 1e-5}, YAML.replace("{}", "{lag: 1e-05}")),
        ({"mpc.known.gain": 7}, YAML.replace("last", "  known: {gain: 7}\nlast")),
        ({"new.a.b": 1, "new.c": 2}, YAML.rstrip("\n") + "\nnew: {a: {b: 1}, c: 2}\n"),
        ({"mpc.delay": 1, "last": 4}, YAML.replace("0.05", "1").replace("3", "4")),
        ({"mpc.slip.topic": ""}, YAML.replace("2}", "2, topic: ''}")),
        ({"last": "a, b"}, YAML.replace("3", "'a, b'")),
    ],
)
def test_only_the_values_change(values: dict[str, float | str], wanted: str) -> None:
    assert with_values(YAML, values) == wanted


def test_a_key_is_added_before_the_comment_of_the_next_section() -> None:
    text = "sensors:\n  imu:\n    rate_hz: 50\n\n# 3.2 V per cell\nfaults: {}\n"
    wanted = text.replace("50\n", "50\n  joints: {rate_hz: 20}\n")
    assert with_values(text, {"sensors.joints.rate_hz": 20.0}) == wanted


@pytest.mark.parametrize(
    "text", ["just words", "mpc: 3", "a: &a {b: 1}\nmpc: *a\n", "mpc: {a: 1,}"]
)
def test_a_text_without_a_simple_place_for_values_is_refused(text: str) -> None:
    with pytest.raises(SettingsError):
        with_values(text, {"mpc.delay": 1.0})


@pytest.mark.parametrize("robot", ["jackal", "robots/turtlebot4", "robots/tracked"])
def test_the_shipped_files_keep_all_other_lines(robot: str) -> None:
    for ending, root in ((".yaml", ()), (".ros.yaml", ("/**", "ros__parameters"))):
        path = CHECKOUT / "config" / f"{robot}{ending}"
        old = path.read_text(encoding="utf-8").splitlines()
        edit = edit_file(path, {"odometry.new": 1.5}, *root)
        new = edit.text().splitlines()
        assert edit.summary == "odometry.new 1.5"
        assert "new: 1.5" in edit.sections
        assert len(set(old) - set(new)) <= 1
        assert [line for line in old if "#" in line] == [line for line in new if "#" in line]


TOPICS = "/**:\r\n  ros__parameters:\r\n    imu: {topic: /imu, depth: 5}  # its own\r\n"


def test_a_section_to_change_is_printed_with_its_other_keys(tmp_path: Path) -> None:
    path = tmp_path / "a.ros.yaml"
    path.write_bytes(TOPICS.encode())
    values: dict[str, float | str] = {"imu.topic": "", "imu.depth": 5, "cmd_vel.type": "a/msg/B"}
    edit = edit_file(path, values, "/**", "ros__parameters")
    assert edit.sections == "imu: {topic: '', depth: 5}\ncmd_vel: {type: a/msg/B}\n"
    assert edit.summary == "imu.topic /imu → '', cmd_vel.type a/msg/B"
    assert installed_warning(edit.path) == ""
    write_edits([edit])
    assert path.read_bytes().decode().startswith(TOPICS.replace("/imu", "''"))
    assert edit_file(path, values, *edit.root).summary == ""
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_no_file_is_written_if_one_cannot_be(tmp_path: Path) -> None:
    first, second = tmp_path / "a.yaml", tmp_path / "b.yaml"
    for path in (first, second):
        path.write_text("a: 1\n")
    second.chmod(0o444)
    with pytest.raises(PermissionError, match="it is read-only"):
        write_edits([edit_file(path, {"a": 2}) for path in (first, second)])
    assert first.read_text() == "a: 1\n"


def test_a_link_remains_one_and_the_mode_is_kept(tmp_path: Path) -> None:
    own, link = tmp_path / "own.yaml", tmp_path / "link.yaml"
    own.write_text("a: 1\n")
    own.chmod(0o640)
    link.symlink_to(own)
    write_edits([edit_file(link, {"a": 2})])
    assert link.is_symlink()
    assert own.read_text() == "a: 2\n"
    assert own.stat().st_mode & 0o777 == 0o640


def test_a_file_of_the_installed_package_has_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "share" / "rover_executive" / "config"
    folder.mkdir(parents=True)
    monkeypatch.setenv("ROVER_CONFIG", str(folder))
    path = folder / "jackal.yaml"
    path.write_bytes((CHECKOUT / "config/jackal.yaml").read_bytes())
    edit = edit_file(path, {"odometry.rate_hz": 40.0})
    assert "belongs to the installed package" in installed_warning(path)
    write_edits([edit])
    assert load_settings("jackal").odometry.rate_hz == 40.0
