"""What the command lines of all processes share, and what they say of packages that are missing."""

import subprocess
import sys
import tomllib
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

import rover_executive
from adapters.process import (
    EXISTING_FILE,
    PORT_NUMBER,
    StartError,
    data_option,
    default_folder,
    log_level_option,
    missing_package,
    process,
)
from adapters.process.command import split_ros_arguments
from adapters.process.start import EXTRAS
from executive.settings import SettingsError

WITHOUT = "import sys; sys.modules[{0!r}] = None; from {1} import {2} as main; main({3!r})"


@process("rover-any")
@click.option("--port", type=PORT_NUMBER)
@click.option("--file", type=EXISTING_FILE)
@click.option("--fault", type=click.Choice(["start", "settings"]))
@data_option("what it keeps")
@log_level_option
@click.pass_obj
def rover_any(
    ros: tuple[str, ...], port: int | None, file: Path | None, fault: str | None, data: Path | None
) -> None:
    if fault == "start":
        raise StartError("the port is taken")
    if fault == "settings":
        raise SettingsError("jackal.yaml: no such key")
    click.echo(f"{data or default_folder('jackal')} {port} {file} {ros}")


def run(*typed: str) -> Result:
    return CliRunner().invoke(rover_any, typed)


def test_the_data_are_in_the_stated_or_the_common_folder(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.delenv("ROVER_DATA", raising=False)
    assert run().output.startswith(f"{tmp_path / 'rover' / 'jackal'} ")
    monkeypatch.setenv("ROVER_DATA", "here")
    assert run().output.startswith("here ")
    assert run("--data", "there").output.startswith("there ")


@pytest.mark.parametrize(
    ("typed", "status", "message"),
    [
        (["--port", "65536"], 2, "65536 is not in the range 0<=x<=65535"),
        (["--port", "-1"], 2, "-1 is not in the range"),
        (["--file", "nowhere.yaml"], 2, "File 'nowhere.yaml' does not exist"),
        (["--log-level", "loud"], 2, "'loud' is not one of 'debug', 'info'"),
        (["--fault", "settings"], 2, "Error: jackal.yaml: no such key"),
        (["--fault", "start"], 1, "Error: the port is taken"),
        (["--ros-args", "-r", "a:=b", "--", "--port", "7"], 0, "7 None ('-r', 'a:=b')"),
    ],
)
def test_an_error_is_reported_in_one_line(typed: list[str], status: int, message: str) -> None:
    done = run(*typed)
    assert done.exit_code == status
    assert message in done.output.splitlines()[-1]


@pytest.mark.parametrize(
    ("line", "own", "ros"),
    [
        ("--port 0", "--port 0", ""),
        ("--port 0 --ros-args -r a:=b", "--port 0", "-r a:=b"),
        ("--ros-args -p x:=1 -- --port 0", "--port 0", "-p x:=1"),
        ("a --ros-args b -- c --ros-args d", "a c", "b d"),
        ("a -- b", "a -- b", ""),
    ],
)
def test_arguments_for_ros_are_set_apart(line: str, own: str, ros: str) -> None:
    assert split_ros_arguments(line.split()) == (own.split(), ros.split())


@pytest.mark.parametrize(
    ("package", "main", "typed", "message"),
    [
        ("rclpy", "adapters.onboard.process:main", [], "Jazzy or newer"),
        ("diagnostic_msgs", "adapters.relay.rover.process:main", [], "Jazzy or newer"),
        ("rclpy", "sim.ros.process:main", [], "Jazzy or newer"),
        ("rclpy", "adapters.cli.main:main", ["watch"], "Jazzy or newer"),
        ("rclpy", "adapters.cli.main:main", ["demo"], "Jazzy or newer"),
        ("usb", "adapters.mocup.brick.process:main", [], "'rover-executive[onboard]'"),
        ("mujoco", "adapters.cli.main:main", ["scenario", "--list"], "'rover-executive[sim]'"),
    ],
)
def test_a_package_that_is_missing_is_named_with_what_brings_it(
    package: str, main: str, typed: list[str], message: str
) -> None:
    code = WITHOUT.format(package, *main.split(":"), typed)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith("Error: ")
    assert message in done.stderr
    assert missing_package(ModuleNotFoundError(name="yaml")) is None


def test_the_extras_exist() -> None:
    declared = tomllib.loads((rover_executive.ROOT / "pyproject.toml").read_text())["project"]
    assert set(EXTRAS.values()) <= declared["optional-dependencies"].keys()


SCRIPTS = ("rover", "console", "executive", "simulation", "orbiter", "relay", "brick")


@pytest.mark.parametrize("package", ["executive", "adapters"])
@pytest.mark.parametrize("script", SCRIPTS)
def test_a_foreign_package_ends_the_start(script: str, package: str, tmp_path: Path) -> None:
    (tmp_path / package).mkdir()
    (tmp_path / package / "__init__.py").touch()
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import rover_executive as start"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; start.{script}()"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    found = tmp_path / package
    assert done.stderr.startswith(f"Error: Python finds package {package} at {found}, and not at")
    assert len(done.stderr.splitlines()) == 1


def test_files_of_another_distribution_end_the_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rover_executive.check_own_packages()
    for package in rover_executive.OWN_PACKAGES:
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").touch()
    monkeypatch.setattr(rover_executive, "ROOT", tmp_path)
    monkeypatch.setattr(
        rover_executive,
        "find_spec",
        lambda name: type("Spec", (), {"origin": str(tmp_path / name / "__init__.py")}),
    )
    for name, file in (("rover_executive", "sim/ours.py"), ("other", "other/adapters/x.py")):
        installed(tmp_path, name, file)
    rover_executive.check_own_packages()
    installed(tmp_path, "adapters", "adapters/__init__.py")
    with pytest.raises(rover_executive.ForeignPackageError) as raised:
        rover_executive.check_own_packages()
    assert str(raised.value).startswith("adapters 1.2 has installed files into")


def installed(folder: Path, name: str, file: str) -> None:
    """Have a distribution in a folder, with one file."""
    information = folder / f"{name}-1.2.dist-info"
    information.mkdir()
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n")
    (information / "RECORD").write_text(f"{file},,\n")
