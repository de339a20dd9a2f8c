"""The launcher `./rover`, with a python3 that keeps a diary instead of installing packages."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
LOCKS = ("requirements.lock", "requirements-test.lock")
SYSTEM_TOOLS = (
    "awk", "cat", "chmod", "cksum", "dirname", "env", "grep", "mkdir", "printf", "readlink", "rm",
    "sh", "sleep", "tail", "tee", "touch", "uname",
)  # fmt: skip

PYTHON = """#!/bin/sh
# Answers questions (-c) with a real interpreter; makes environments of two scripts; never installs.
case "$1" in
    -c) exec {real} "$@" ;;
    --version) echo "Python 3.12.0"; exit ;;
esac
echo "$*" >>{diary}
case "$2" in
    venv)
        mkdir -p "$4/bin"
        cat "$0" >"$4/bin/python"
        cat {command} >"$4/bin/rover"
        chmod +x "$4/bin/python" "$4/bin/rover" ;;
    pip)
        echo "Collecting first==1"
        echo "Collecting second==2"
        if [ -e {gate} ]; then read -r opened <{gate}; fi
        if [ -e {broken} ]; then echo "ERROR: no such package"; exit 7; fi ;;
esac
"""

COMMAND = """#!/bin/sh
echo "started with: $*"
echo "PYTHONPATH=${PYTHONPATH-unset} PROFILE=${FASTRTPS_DEFAULT_PROFILES_FILE-unset}"
echo "FAST_DDS_3=${FASTDDS_DEFAULT_PROFILES_FILE-unset}"
echo "RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE-unset}"
echo "INSTALLED=${ROVER_INSTALLED-no}"
exit 5
"""


@dataclass(frozen=True, slots=True)
class Bench:
    """A checkout that holds what the launcher reads, and a PATH with few programs."""

    checkout: Path
    tools: Path
    diary: Path
    broken: Path
    gate: Path

    def start(
        self,
        *arguments: str,
        program: Path | None = None,
        cwd: Path | None = None,
        env: Mapping[str, str] | None = None,
    ) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [program or self.checkout / "rover", *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=cwd,
            env=self.environment() | dict(env or {}),
        )

    @contextmanager
    def begin(self) -> Iterator[subprocess.Popen[str]]:
        """Start without waiting for the end; what is left at the end of the `with` is killed."""
        with subprocess.Popen(
            [self.checkout / "rover"],
            env=self.environment(),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        ) as process:
            try:
                yield process
            finally:
                with suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)

    def environment(self) -> dict[str, str]:
        return {"PATH": str(self.tools), "HOME": str(self.checkout)}

    def steps(self) -> list[str]:
        """Return what the interpreter was asked to run since the last call: venv, pip, pip, …"""
        lines = self.diary.read_text().splitlines() if self.diary.exists() else []
        self.diary.unlink(missing_ok=True)
        return [line.split()[1] for line in lines]

    def put_python(self, name: str = "python3", text: str | None = None) -> None:
        path = self.tools / name
        path.write_text(
            text
            or PYTHON.format(
                real=os.path.realpath(sys.executable),
                diary=self.diary,
                broken=self.broken,
                gate=self.gate,
                command=self.tools / "command",
            )
        )
        path.chmod(0o755)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    checkout = tmp_path / "a checkout"
    tools = tmp_path / "bin"
    checkout.mkdir()
    tools.mkdir()
    for name in ("rover", *LOCKS, "pyproject.toml", "setup.py"):
        shutil.copy(CHECKOUT / name, checkout)
    for name in SYSTEM_TOOLS:
        found = shutil.which(name)
        assert found is not None, name
        (tools / name).symlink_to(found)
    (tools / "command").write_text(COMMAND)
    bench = Bench(checkout, tools, tmp_path / "diary", tmp_path / "broken", tmp_path / "gate")
    bench.put_python()
    return bench


def test_first_start_makes_the_environment_and_the_second_only_starts(bench: Bench) -> None:
    first = bench.start("status", "--json")
    assert first.stdout.startswith("started with: status --json\n"), first.stderr
    assert first.returncode == 5
    assert "[1/2]" in first.stderr
    assert first.stderr.endswith("rover: ready\n")
    assert "requirements-test.lock" not in first.stderr
    assert bench.steps() == ["venv", "pip", "pip"]
    assert "INSTALLED=yes" in first.stdout

    second = bench.start()
    assert second.returncode == 5
    assert "INSTALLED=no" in second.stdout
    assert second.stderr == ""
    assert bench.steps() == []


def test_starts_from_anywhere_and_through_a_link(bench: Bench, tmp_path: Path) -> None:
    link = tmp_path / "link to rover"
    link.symlink_to(bench.checkout / "rover")
    assert bench.start("x", program=link, cwd=Path("/")).stdout.startswith("started with: x\n")
    assert (bench.checkout / ".venv" / "rover-stamp").exists()


def test_changed_lock_updates_in_place(bench: Bench) -> None:
    bench.start()
    bench.steps()
    with (bench.checkout / "requirements.lock").open("a") as lock:
        lock.write("# changed\n")
    assert "changed" in bench.start().stderr
    assert bench.steps() == ["pip", "pip"]


@pytest.mark.parametrize("command", ["test", "bench", "extras"])
def test_the_first_command_that_needs_more_adds_the_second_lock(command: str, bench: Bench) -> None:
    bench.start("demo")
    bench.steps()
    added = bench.start(command, "-x")
    assert added.stdout.startswith(f"started with: {command} -x\n"), added.stderr
    assert "tests and all extras: packages of requirements-test.lock" in added.stderr
    assert bench.steps() == ["pip"]
    wanted = (bench.checkout / ".venv" / "requirements.txt").read_text()
    assert wanted == (CHECKOUT / "requirements-test.lock").read_text()
    assert bench.start(command).stderr == bench.start("demo").stderr == ""
    assert bench.steps() == []


def test_help_of_the_extras_installs_none(bench: Bench) -> None:
    bench.start("demo")
    bench.steps()
    assert bench.start("extras", "--help").stdout.startswith("started with: extras --help\n")
    assert bench.steps() == []


def test_a_bare_machine_that_tests_installs_both_locks(bench: Bench) -> None:
    assert bench.start("test").returncode == 5
    assert bench.steps() == ["venv", "pip", "pip", "pip"]


def test_a_change_of_the_second_lock_matters_to_tests_alone(bench: Bench) -> None:
    bench.start("test")
    bench.steps()
    with (bench.checkout / "requirements-test.lock").open("a") as lock:
        lock.write("# changed\n")
    assert bench.start("demo").stderr == ""
    assert bench.steps() == []
    bench.broken.touch()
    assert bench.start("test").returncode == 1
    bench.broken.unlink()
    assert bench.steps() == ["pip"]
    assert bench.start("test").returncode == 5
    assert bench.steps() == ["pip"]


@pytest.mark.parametrize("of_one_lock", [False, True])
def test_a_change_of_both_locks_updates_the_extras_too(of_one_lock: bool, bench: Bench) -> None:
    bench.start("test")
    if of_one_lock:  # an environment of the time when there was one lock
        (bench.checkout / ".venv" / "rover-full-stamp").unlink()
        (bench.checkout / ".venv" / "lib/python3.12/site-packages/pandas").mkdir(parents=True)
    bench.steps()
    for name in LOCKS:
        with (bench.checkout / name).open("a") as lock:
            lock.write("# changed\n")
    assert "packages of requirements-test.lock" in bench.start().stderr
    assert bench.steps() == ["pip", "pip", "pip"]
    assert bench.start("test").stderr == ""


def test_moved_checkout_gets_a_new_environment(bench: Bench, tmp_path: Path) -> None:
    bench.start()
    bench.steps()
    bench.checkout.rename(tmp_path / "moved")
    bench.start(program=tmp_path / "moved" / "rover")
    assert bench.steps() == ["venv", "pip", "pip"]


def test_failed_install_reports_the_reason_and_is_repeated(bench: Bench) -> None:
    bench.broken.touch()
    failed = bench.start()
    assert failed.returncode == 1
    assert "ERROR: no such package" in failed.stderr
    assert "install.log" in failed.stderr
    bench.steps()
    bench.broken.unlink()
    assert bench.start().returncode == 5
    assert bench.steps() == ["venv", "pip", "pip"]


def test_a_second_first_start_waits_for_the_first(bench: Bench) -> None:
    os.mkfifo(bench.gate)
    with bench.begin() as first:
        assert first.stderr is not None
        assert any("[2/2]" in line for line in iter(first.stderr.readline, ""))
        with bench.begin() as second:
            assert second.stderr is not None
            assert "waiting for another first start" in second.stderr.readline()
            with bench.gate.open("w") as gate:
                bench.gate.unlink()
                gate.write("open\n")
            assert "started with:" in second.communicate()[0]
        assert "started with:" in first.communicate()[0]
    assert bench.steps() == ["venv", "pip", "pip"]


def test_names_the_missing_python(bench: Bench) -> None:
    (bench.tools / "python3").unlink()
    refused = bench.start()
    assert refused.returncode == 1
    assert "Python 3.11 to 3.14 is needed" in refused.stderr
    assert "apt install python3 python3-venv" in refused.stderr


def test_names_the_missing_venv_module(bench: Bench) -> None:
    real = os.path.realpath(sys.executable)
    bench.put_python(
        text=f'#!/bin/sh\ncase "$2" in *ensurepip*) exit 1 ;; esac\nexec {real} "$@"\n'
    )
    refused = bench.start()
    assert refused.returncode == 1
    assert "lacks the module venv" in refused.stderr
    assert "apt install python3-venv" in refused.stderr
    assert not (bench.checkout / ".venv").exists()


@pytest.mark.parametrize(
    "sourced",
    [{"ROS_DISTRO": "humble"}, {"AMENT_PREFIX_PATH": "/opt/ros/humble"}],
    ids=["ROS_DISTRO", "AMENT_PREFIX_PATH"],
)
def test_refuses_a_sourced_ros_that_does_not_fit(bench: Bench, sourced: dict[str, str]) -> None:
    bench.start()
    bench.steps()
    refused = bench.start(env=sourced)
    assert refused.returncode == 1
    assert "a ROS is sourced" in refused.stderr
    assert "no ROS is sourced: then ROS comes as wheels" in refused.stderr.replace("\n", " ")
    assert bench.steps() == []


@pytest.mark.parametrize("distribution", ["jazzy", "kilted", "lyrical", "rolling"])
def test_a_fitting_ros_has_an_environment_without_wheels(
    distribution: str, bench: Bench, tmp_path: Path
) -> None:
    (tmp_path / "ros").mkdir()
    (tmp_path / "ros" / "rclpy.py").touch()
    started = bench.start(env={"ROS_DISTRO": distribution, "PYTHONPATH": str(tmp_path / "ros")})
    assert f"PYTHONPATH={tmp_path / 'ros'} PROFILE=unset" in started.stdout, started.stderr
    assert not (bench.checkout / ".venv").exists()
    wanted = (bench.checkout / ".venv-ros" / "requirements.txt").read_text()
    names = {line.split("==")[0] for line in wanted.splitlines() if line[0].isalpha()}
    assert {"py-trees", "click"} <= names
    assert not [name for name in names if name.startswith("ros-")]


def test_with_wheels_nothing_of_another_ros_gets_in(bench: Bench) -> None:
    started = bench.start(env={"PYTHONPATH": "/elsewhere", "LD_LIBRARY_PATH": "/elsewhere"})
    assert "PYTHONPATH=unset" in started.stdout
    assert f"PROFILE={bench.checkout}/config/fastdds.xml" in started.stdout
    assert f"FAST_DDS_3={bench.checkout}/config/fastdds.xml" in started.stdout


@pytest.mark.parametrize("name", ["FASTRTPS", "FASTDDS"])
def test_preserves_the_profile_chosen_by_the_user(name: str, bench: Bench) -> None:
    started = bench.start(env={f"{name}_DEFAULT_PROFILES_FILE": "/my/profile.xml"})
    assert "PROFILE=/my/profile.xml" in started.stdout
    assert "FAST_DDS_3=/my/profile.xml" in started.stdout


def test_a_discovery_range_is_followed_by_commands_to_a_robot_alone(bench: Bench) -> None:
    env = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    robot = bench.start("robot", "new", "scout", env=env).stdout
    assert "PROFILE=unset" in robot
    assert "RANGE=SUBNET" in robot
    demo = bench.start("demo", env=env).stdout
    assert f"PROFILE={bench.checkout}/config/fastdds.xml" in demo
    assert "RANGE=unset" in demo
