"""`docs/run-as-a-service.md` typed on a computer with systemd: install, kill, upgrade, roll back.

The computer is systemd as process 1 of its own namespaces, with private copies of /etc, /opt and
/var/lib. It needs root and a Python outside of home folders, so that it is no part of the suite:
`rover test --stress` runs it.
"""

import os
import re
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.mrs.spec import describe_error
from executive.commands import Command
from executive.commands.catalogue import SetTravelSpeed
from tests.conftest import port_of, reserved_domain
from tests.docs.pages import blocks
from tests.support.ground import call_ground
from tests.support.wheel import CHECKOUT, build_wheel

PAGE = CHECKOUT / "docs" / "run-as-a-service.md"
LIMIT_S = 120.0
SYSTEM_PYTHON = Path("/usr/bin/python{}.{}".format(*sys.version_info))
TARGETS = ("sysinit", "basic", "shutdown", "umount", "multi-user", "default", "rescue")
NOT_TYPED = re.compile(r"journalctl .*-f|sudo systemctl edit|systemctl status")
"""Lines that stay, or open an editor."""
BOOT = """
set -e
mount --make-rprivate /
mount -t tmpfs tmpfs /run
for folder in etc opt var/lib; do
    mkdir -p /run/over/$folder /run/work/$folder
    mount -t overlay overlay /$folder \
        -o "lowerdir=/$folder,upperdir=/run/over/$folder,workdir=/run/work/$folder"
done
umount -R /sys/fs/cgroup
mount -t cgroup2 cgroup2 /sys/fs/cgroup
mount -t proc proc /proc
mkdir -p /run/units /run/bin /opt/ros/jazzy
touch /opt/ros/jazzy/setup.sh
for name in $TARGETS; do
    printf '[Unit]\\nDefaultDependencies=no\\n' >/run/units/$name.target
done
printf '#!/bin/sh\\nif [ "$1" = -u ]; then user=$2; shift 2; \
exec env -i PATH="$PATH" \
setpriv --reuid $user --regid $user --clear-groups "$@"; fi\\nexec "$@"\\n' >/run/bin/sudo
chmod +x /run/bin/sudo
export SYSTEMD_UNIT_PATH=/etc/systemd/system:/run/units SYSTEMD_LOG_TARGET=console container=test
exec /lib/systemd/systemd --system --unit=default.target
"""


class Computer:
    """A computer with systemd; `run` types a line there, as root."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder, self.domain = folder, domain
        self.port = port_of(domain)
        names = ("mount", "pid", "cgroup", "uts", "ipc")
        command = ["unshare", *(f"--{each}" for each in names), "--fork", "--kill-child"]
        self._log = (folder / "boot").open("wb")
        self._process = subprocess.Popen(
            [*command, "sh", "-c", BOOT],
            env={**os.environ, "TARGETS": " ".join(TARGETS)},
            stdout=self._log, stderr=self._log,
        )  # fmt: skip
        until_s = time.monotonic() + LIMIT_S
        while not self._is_up():
            if self._process.poll() is not None or time.monotonic() > until_s:
                self.close()
                pytest.skip(f"systemd does not start: {(folder / 'boot').read_text()[-200:]}")
            time.sleep(0.1)

    def _is_up(self) -> bool:
        children = Path(f"/proc/{self._process.pid}/task/{self._process.pid}/children")
        self._init = children.read_text().strip() if children.exists() else ""
        return bool(self._init) and self.run("systemctl show", check=False).returncode == 0

    def run(self, line: str, *, check: bool = True) -> subprocess.CompletedProcess[str]:
        enter = ("nsenter", "--target", self._init, "--mount", "--pid", "--cgroup")
        done = subprocess.run(
            [*enter, "sh", "-c", line],
            cwd=self.folder,
            env={
                "PATH": "/run/bin:/usr/bin:/usr/sbin:/bin:/sbin",
                "USER": "root",
                "PIP_NO_DEPS": "1",
                "PIP_NO_INDEX": "1",
            },
            capture_output=True, text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
        assert not check or done.returncode == 0, f"{line}: {done.stdout}{done.stderr}"
        return done

    def type_block(self, block: str) -> None:
        """Type the lines of a block of the page, in the folder of the wheels."""
        folder = str(self.folder)
        for line in block.splitlines():
            if NOT_TYPED.search(line):
                continue
            if line.startswith("cd "):
                folder = line[3:]
                continue
            is_doctor = "rover doctor" in line
            done = self.run(f"cd {folder} && {line}", check=not is_doctor)
            if is_doctor:  # no robot runs here
                results = re.findall(r"^(\w+) +(\w+): ", done.stdout, re.MULTILINE)
                assert {name for level, name in results if level == "error"} <= {"robot"}, done
                assert ("ok", "data") in results
            if made := re.fullmatch(r"sudo python3 -m venv (\S+)", line):
                self._share_packages(made[1])

    def _share_packages(self, environment: str) -> None:
        """Show the packages of this environment in one that was made, since there is no network."""
        new = f"/run/lib{environment}"
        self.run(
            f"mkdir -p {new} {new}.work && mount -t overlay overlay {environment}/lib"
            f" -o lowerdir={sys.prefix}/lib,upperdir={new},workdir={new}.work"
        )

    def show(self, unit: str, *names: str) -> list[str]:
        values = (self.run(f"systemctl show -P {name} {unit}") for name in names)
        return [each.stdout.strip() for each in values]

    def set_options(self, asset: str, *lines: str) -> None:
        common = (f"ROS_DOMAIN_ID={self.domain}", "FASTDDS_BUILTIN_TRANSPORTS=")
        self.run(f"cat >/etc/rover/{asset}.env <<'END'\n{chr(10).join((*common, *lines))}\nEND\n")

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._log.close()


def save_next_version(wheel: Path, folder: Path) -> None:
    """Save a wheel as another version, without a change of its code."""
    old, new = "0.1.0", "0.2.0"
    with (
        zipfile.ZipFile(wheel) as before,
        zipfile.ZipFile(folder / wheel.name.replace(old, new), "w") as after,
    ):
        for name in before.namelist():
            content = before.read(name)
            if name.endswith((".dist-info/METADATA", ".dist-info/RECORD")):
                content = content.replace(old.encode(), new.encode())
            after.writestr(name.replace(old, new), content)


@pytest.fixture(scope="module")
def computer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Computer]:
    """Give a computer with the wheels of two versions in the present folder."""
    if os.getuid() != 0 or not SYSTEM_PYTHON.exists():
        pytest.skip(f"root and {SYSTEM_PYTHON} are needed")
    folder = tmp_path_factory.mktemp("computer")
    wheel = build_wheel(tmp_path_factory.mktemp("built"))
    shutil.copy(wheel, folder)
    save_next_version(wheel, folder)
    with reserved_domain() as domain:
        computer = Computer(folder, domain)
        try:
            yield computer
        finally:
            computer.close()


UNIT = "rover-executive@jackal"
INSTALL, EDIT, START, UPGRADE, ROLL_BACK = blocks(PAGE, "console")
SENT: list[Command] = []
"""The command that each version receives."""


def answer(computer: Computer) -> str:
    """Send the same command again; return how it ended."""

    async def send(client: MrsClient) -> str:
        SENT[:] = SENT or [client.command(SetTravelSpeed(0.2))]
        outcome = await client.run(SENT[0])
        if outcome.executed:
            return "executed"
        assert outcome.refusal is not None
        return describe_error(outcome.refusal)

    return call_ground(f"127.0.0.1:{computer.port}", send)


def until(computer: Computer, unit: str, restarts: str) -> None:
    """Wait until a service was restarted, and is ready."""
    until_s = time.monotonic() + LIMIT_S
    while computer.show(unit, "ActiveState", "NRestarts") != ["active", restarts]:
        assert time.monotonic() < until_s, computer.run(f"systemctl status {unit}", check=False)
        time.sleep(0.2)


@pytest.fixture(scope="module")
def installed(computer: Computer) -> Computer:
    """Install and start the first version as on the page."""
    assert "systemctl edit" in EDIT
    (drop_in,) = blocks(PAGE, "ini")
    folder = "/etc/systemd/system/rover-executive@.service.d"
    log = "[Service]\nStandardError=append:/run/log\n"  # no journal runs there
    computer.run(f"mkdir -p {folder} && printf '%s{log}' '{drop_in}' >{folder}/override.conf")
    computer.type_block(INSTALL)
    computer.set_options("jackal", f"EXECUTIVE_OPTIONS=--port {computer.port}")
    computer.type_block(START)
    return computer


def test_the_service_runs_with_its_rights(installed: Computer) -> None:
    text, state, number = installed.show(UNIT, "StatusText", "ActiveState", "MainPID")
    assert (state, text) == ("active", f"jackal listens at maltcp://127.0.0.1:{installed.port}/MRS")
    rights = installed.run(f"cat /proc/{number}/status").stdout
    assert re.search(r"CapBnd:\s0+\n", rights)
    assert re.search(r"NoNewPrivs:\s1\n", rights)
    assert installed.run("stat -c '%U %a' /var/lib/rover/jackal").stdout == "rover 750\n"
    installed.run(f"nsenter --target {number} --mount cat /proc/stat")  # for process metrics
    assert installed.show(UNIT, "Nice") == ["-10"]
    assert answer(installed) == "executed"


ZERO = "the executive has ended: zero was published"


def zeros_after_kill(computer: Computer) -> int:
    """Return how often the guard published zero, after one kill -9 of an executive."""
    other = "rover-executive@robots-leo"
    computer.set_options("robots-leo", "EXECUTIVE_OPTIONS=--port 0")
    computer.run(f"systemctl daemon-reload; systemctl start {other}; >/run/log")
    (number,) = computer.show(other, "MainPID")
    computer.run(f"kill -9 {number}")
    until(computer, other, "1")
    computer.run(f"systemctl stop {other}")
    assert computer.show(other, "Result", "ExecMainStatus") == ["success", "0"]
    return computer.run("cat /run/log").stdout.count(ZERO)


def test_the_guard_stops_the_rover_before_the_next_start(installed: Computer) -> None:
    assert zeros_after_kill(installed) == 1


def test_another_kill_mode_would_end_the_guard(installed: Computer) -> None:
    folder = "/etc/systemd/system/rover-executive@robots-leo.service.d"
    installed.run(f"mkdir {folder} && printf '[Service]\nKillMode=mixed\n' >{folder}/mixed.conf")
    assert zeros_after_kill(installed) == 0
    installed.run(f"rm -r {folder} && systemctl daemon-reload")


def test_a_wrong_option_is_not_tried_again(installed: Computer) -> None:
    other = "rover-executive@robots-turtlebot4"
    installed.set_options("robots-turtlebot4", "EXECUTIVE_OPTIONS=--prot 0")
    assert installed.run(f"systemctl start {other}", check=False).returncode != 0
    time.sleep(2.0)
    assert installed.show(other, "ActiveState", "NRestarts") == ["failed", "0"]


def test_an_upgrade_and_a_rollback_preserve_the_ledger(installed: Computer) -> None:
    for block, version in ((UPGRADE, "0.2.0"), (ROLL_BACK, "0.1.0")):
        installed.type_block(block)
        assert (
            installed.run("/opt/rover/current/bin/rover --version").stdout == f"rover {version}\n"
        )
        assert installed.show(UNIT, "ActiveState") == ["active"]
        assert answer(installed).startswith("Duplicate")
    installed.run(f"systemctl stop {UNIT}")
    assert installed.show(UNIT, "Result", "ExecMainStatus") == ["success", "0"]
