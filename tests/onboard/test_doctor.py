"""`rover doctor` finds each obstacle by name, and prints the command that removes it."""

import json
import os
import pwd
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from click.testing import CliRunner

from adapters.cli import doctor
from adapters.cli.doctor import Level, Subject
from executive.settings import (
    NavigationGate,
    NavigationSettings,
    config_folder,
    load_settings,
)
from tests.stress.small_disk import NoDiskError, small_disk

CHECKOUT = Path(__file__).resolve().parents[2]
UNPRIVILEGED_USER = 65534
OTHER_USER = pwd.getpwuid(os.getuid() or UNPRIVILEGED_USER).pw_name
HERE = Subject(Path("/"))
Results = list[tuple[Level, str, str]]


def found(results: Any, level: Level) -> tuple[str, str]:
    """Return text and remedy of the only result of a level."""
    ((text, remedy),) = [(text, remedy) for each, text, remedy in results if each is level]
    return text, remedy


def run(*arguments: str, path: Path = CHECKOUT, **environment: str) -> Results:
    """Run the command in a process of its own; an error is its exit status, too."""
    program = "from adapters.cli.doctor import doctor; doctor()"
    done = subprocess.run(
        [sys.executable, "-c", program, "--json", *arguments],
        env={**os.environ, "PYTHONPATH": f"{path}:{CHECKOUT}", **environment},
        cwd="/", capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    rows = json.loads(done.stdout)
    assert done.returncode == any(row["level"] == "error" for row in rows)
    return [(Level(row["level"]), f"{row['check']}: {row['text']}", row["remedy"]) for row in rows]


def without_rights(check: Callable[[], Any]) -> Results:
    """Return the results of a check without the rights of root."""
    if os.getuid() != 0:
        return list(check())
    list(check())  # without rights its imports may be out of reach
    reading, writing = os.pipe()
    if (child := os.fork()) == 0:
        try:
            os.setuid(UNPRIVILEGED_USER)
            os.write(writing, json.dumps(list(check())).encode())
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    os.close(writing)
    with open(reading) as results:
        return [(Level(level), text, remedy) for level, text, remedy in json.load(results)]


def test_a_check_that_raises_is_an_error_and_the_others_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = shutil.copytree(config_folder(), tmp_path / "config")
    monkeypatch.setenv("ROVER_CONFIG", str(config))
    monkeypatch.setattr(doctor, "ABOARD", (doctor._brick, doctor._port))
    brick = config / "mocup.nxt.yaml"
    text = brick.read_text()
    for invalid in ("", text.replace("    usb:", "   usb:"), text.replace("    usb:", "    us:")):
        brick.write_text(invalid)
        done = CliRunner().invoke(doctor.doctor, ["--asset", "mocup", "--json"])
        rows = json.loads(done.output)
        (row,) = [row for row in rows if row["check"] == "brick"]
        assert row["text"].startswith("this check failed: ")
        assert (row["level"], rows[-1]["check"], done.exit_code) == ("error", "port", 1)
    brick.write_text(text.replace("/**:", "/mocup/nxt:"))
    subject = Subject(tmp_path, "mocup", load_settings("mocup"))
    assert found(doctor._brick(subject), Level.WARNING)[1] == "lsusb"


def test_a_user_without_a_home_is_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "home", Mock(side_effect=RuntimeError("no home directory")))
    monkeypatch.delenv("XDG_DATA_HOME", raising=False)
    text, _ = found(doctor._guarded(doctor._data, Subject(None)), Level.ERROR)
    assert text == "this check failed: RuntimeError: no home directory"
    assert found(doctor._guarded(doctor._python, Subject(None)), Level.OK)


def test_a_middleware_that_is_missing_is_an_error() -> None:
    text, remedy = found(run("--asset", "jackal", RMW_IMPLEMENTATION="rmw_none_cpp"), Level.ERROR)
    assert text.startswith("ros: rclpy does not start: ")
    assert "Expected RMW implementation identifier of 'rmw_none_cpp'" in text
    assert remedy == "unset RMW_IMPLEMENTATION"


def test_no_ros_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    text, remedy = found(doctor._ros(HERE), Level.ERROR)
    assert text == "no ROS: Python finds no rclpy"
    assert remedy.startswith((". /opt/ros/", "sudo apt", sys.executable, "./rover extras"))


def test_wheels_beside_a_sourced_ros_are_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMENT_PREFIX_PATH", "/opt/ros/jazzy")
    ((level, text, _),) = doctor._ros(HERE)
    assert (level, "their libraries mix" in text) == (Level.ERROR, True)


def test_a_missing_package_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "usb", None)
    monkeypatch.setattr(doctor, "program", lambda: "rover")
    results = [each for each in doctor._packages(HERE) if "usb" in each[1]]
    assert found(results, Level.OK)[1].endswith("-m pip install 'rover-executive[onboard]'")
    monkeypatch.setattr(doctor, "program", lambda: "./rover")
    results = [each for each in doctor._packages(HERE) if "usb" in each[1]]
    assert found(results, Level.OK)[1] == "./rover extras"


@pytest.mark.parametrize(
    ("name", "value", "reported"),
    [
        ("ROS_DOMAIN_ID", "200", "ROS_DOMAIN_ID is '200': a number from 0 to 101"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCAL", "'LOCAL', not one of SUBNET LOCALHOST"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/missing.xml", "there is no file /missing.xml"),
    ],
)
def test_a_wrong_variable_is_an_error(
    name: str, value: str, reported: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    assert reported in found(doctor._domain(HERE), Level.ERROR)[0]


@pytest.mark.ros
def test_a_robot_in_another_domain_is_found(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from adapters.ros import ros_node

    taken = {ros_domain, *doctor.local_domains()}
    # From the other end than `ros_domain`: else a test that begins meanwhile takes it.
    other = next(each for each in range(100, 0, -1) if each not in taken)
    monkeypatch.setattr(doctor, "LISTEN_S", 0.2)
    with ros_node("base", "jackal", domain_id=ros_domain):
        monkeypatch.setenv("ROS_DOMAIN_ID", str(other))
        results = [*doctor._domain(HERE)]
        text, remedy = found(results, Level.WARNING)
        assert str(ros_domain) in text.partition("in ")[2].split(", ")
        assert remedy.startswith("export ROS_DOMAIN_ID=")
        subject = Subject(Path("/"), "jackal", load_settings("jackal"))
        text, remedy = found(doctor._robot(subject), Level.ERROR)
        assert f"no node has a topic of jackal in ROS domain {other}; there are nodes in" in text
        assert remedy.startswith("export ROS_DOMAIN_ID=")


@pytest.mark.ros
def test_a_robot_in_another_namespace_is_found(
    ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from nav_msgs.msg import Odometry

    from adapters.ros import ros_node

    monkeypatch.setattr(doctor, "LISTEN_S", 3.0)
    subject = Subject(Path("/"), "jackal", load_settings("jackal"))
    with ros_node("base", "j100_0001", domain_id=ros_domain) as base:
        base.create_publisher(Odometry, "ekf/odom", 1)
        text, remedy = found(doctor._robot(subject), Level.ERROR)
        assert "in namespace /jackal; topics of their types are in /j100_0001" in text
        assert remedy.endswith("doctor --asset jackal --namespace /j100_0001")
        subject = replace(subject, namespace="j100_0001")
        texts = [text for level, text, _ in doctor._robot(subject) if level is Level.ERROR]
    assert "/j100_0001/ekf/odom (Odometry) would fit" in texts[0]


def test_a_disk_that_is_full_or_read_only_is_an_error(tmp_path: Path) -> None:
    try:
        with small_disk(tmp_path / "disk") as disk:
            subject = Subject(disk.folder / "data")
            assert found(doctor._data(subject), Level.OK)
            disk.fill()
            text, remedy = found(doctor._data(subject), Level.ERROR)
            assert "/data: 0 MB free" in text
            assert "100 MB are needed" in text
            assert remedy.startswith("du -xh ")
            disk.empty()
            subprocess.run(["mount", "-o", "remount,ro", str(disk.folder)], check=True)
            text, remedy = found(doctor._data(subject), Level.ERROR)
            assert (text, "remount,rw" in remedy) == (
                f"{subject.data}: Read-only file system",
                True,
            )
    except NoDiskError as error:
        pytest.skip(str(error))


def test_a_ledger_of_another_user_is_an_error(tmp_path: Path) -> None:
    folder = tmp_path / "my data"
    folder.mkdir(mode=0o755)
    ledger = folder / "ledger.sqlite"
    ledger.touch(mode=0o400)
    for each in (folder, *folder.parents[:-2]):
        each.chmod(0o777)
    text, remedy = found(without_rights(lambda: doctor._data(Subject(folder))), Level.ERROR)
    assert "no right to write ledger.sqlite" in text
    assert remedy == f"sudo chown -R {OTHER_USER} '{folder}'"


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    for each in (tmp_path, *tmp_path.parents[:-2]):
        each.chmod(0o755)
    folder = tmp_path / "rover" / "jackal"
    text, remedy = found(without_rights(lambda: doctor._data(Subject(folder))), Level.ERROR)
    assert (text, remedy) == (
        f"{folder}: Permission denied",
        f"sudo install -d -o {OTHER_USER} {folder}",
    )


def test_a_file_with_the_name_of_the_folder_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "data").touch()
    for folder in (tmp_path / "data", tmp_path / "data" / "jackal"):
        text, remedy = found(doctor._data(Subject(folder)), Level.ERROR)
        assert text == f"{folder}: Not a directory"
        assert remedy == f"mv {tmp_path}/data {tmp_path}/data.old"


def test_a_user_without_a_name_is_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 54321)
    assert doctor._user() == "54321"


def test_a_priority_that_is_not_permitted_is_a_warning() -> None:
    text, remedy = found(without_rights(lambda: doctor._priority(HERE)), Level.WARNING)
    assert text.startswith("nice -10 is permitted to units only")
    assert remedy.startswith(f"echo '{OTHER_USER} - nice -10' | sudo tee /etc/security/limits.d")


def test_shared_memory_of_another_user_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    segment = tmp_path / "fastrtps_1"
    segment.touch(mode=0o444)
    (tmp_path / "fastrtps_2").symlink_to(tmp_path / "vanished")
    monkeypatch.setattr(doctor, "SHARED_MEMORY", tmp_path)
    monkeypatch.delenv("FASTDDS_BUILTIN_TRANSPORTS", raising=False)
    for each in (tmp_path, *tmp_path.parents[:-2]):
        each.chmod(0o755)
    text, remedy = found(without_rights(lambda: doctor._discovery(HERE)), Level.WARNING)
    assert f"shared memory of Fast DDS is that of user {os.getuid()}" in text
    assert remedy == "export FASTDDS_BUILTIN_TRANSPORTS=UDPv4"


def test_a_clock_before_the_installation_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    later = tmp_path / "doctor.py"
    later.touch()
    os.utime(later, (time.time() + 1000,) * 2)
    monkeypatch.setattr(doctor, "__file__", str(later))
    assert "before this program was installed" in found(doctor._clock(HERE), Level.ERROR)[0]


def test_a_port_in_use_is_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        number = other.getsockname()[1]
        monkeypatch.setattr("adapters.mrs.spec.PORT", number)
        text, remedy = found(doctor._port(HERE), Level.WARNING)
    assert text == f"TCP {number}: Address already in use; perhaps an executive runs"
    assert remedy == f"ss -ltnp 'sport = :{number}'"


def test_a_navigation_without_its_messages_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "kilted")
    monkeypatch.setattr(doctor, "find_spec", lambda _: None)
    jackal = load_settings("jackal")
    assert not list(doctor._navigation(replace(HERE, asset="jackal", settings=jackal)))
    navigated = replace(jackal, mux=None, navigation=NavigationSettings(NavigationGate.RELAY))
    subject = replace(HERE, asset="jackal", settings=navigated)
    text, remedy = found(doctor._navigation(subject), Level.ERROR)
    assert "771" in text
    assert remedy == "sudo apt install ros-kilted-nav2-msgs"
    monkeypatch.setattr(doctor, "find_spec", lambda _: object())
    assert found(doctor._navigation(subject), Level.OK)


def test_the_brick_is_found_with_its_rights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    subject = Subject(tmp_path, "mocup", load_settings("mocup"))
    monkeypatch.setattr(doctor, "USB", tmp_path)
    assert found(doctor._brick(subject), Level.WARNING)[1] == "lsusb"
    uevent = tmp_path / "1-1" / "uevent"
    uevent.parent.mkdir()
    uevent.write_text(f"DEVNAME={tmp_path}/004\nDEVTYPE=usb_device\nPRODUCT=694/2/0\n")
    text, remedy = found(doctor._brick(subject), Level.ERROR)
    assert text == f"no right to write {tmp_path}/004, the brick"
    assert Path(remedy.split()[2]).is_file()
    (tmp_path / "004").touch()
    assert found(doctor._brick(subject), Level.OK)


def test_lines_have_level_and_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "GROUND", (doctor._python,))
    monkeypatch.setattr(doctor, "TESTED", ())
    done = CliRunner().invoke(doctor.doctor, ["--ground"])
    first, second = done.output.splitlines()
    assert first.startswith("warning python: 3.")
    assert second == "          sudo apt install python3.13-venv"
    assert done.exit_code == 0


def test_an_unknown_asset_is_a_usage_error() -> None:
    done = CliRunner().invoke(doctor.doctor, ["--asset", "jakcal"])
    assert (done.exit_code, "jackal" in done.output) == (2, True)
