"""The systemd units: valid, hardened, and their command lines run, confined as by systemd."""

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

import pytest

from adapters.mrs.ground import MrsClient
from adapters.process import ALIVE, announce, notify, watchdog_period_s
from tests.conftest import port_of
from tests.support.confined import Unit
from tests.support.ground import call_ground
from tests.support.processes import LIMIT_S

CHECKOUT = Path(__file__).resolve().parents[2]
FOLDER = CHECKOUT / "config" / "systemd"
UNITS = sorted(FOLDER.glob("*.service"))
MAX_EXPOSURE = 30  # of systemd-analyze, in tenths
if shutil.which("systemd-analyze") is None and "ROVER_CI" not in os.environ:
    pytest.skip("systemd-analyze is not installed", allow_module_level=True)


def analyze(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    command = ["systemd-analyze", *map(str, arguments)]
    environment = {**os.environ, "SYSTEMD_PAGER": "", **environment}
    return subprocess.run(command, capture_output=True, text=True, env=environment)


def verify(folder: Path, unit: Path, text: str) -> str:
    """Return the complaints of systemd-analyze about an instance of a unit."""
    instance = folder / unit.name.replace("@", "@jackal")
    instance.write_text(text)
    done = analyze("verify", "--man=no", instance, SYSTEMD_UNIT_PATH=f"{folder}:")
    return done.stderr if done.returncode or unit.name[:9] in done.stderr else ""


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_units_are_valid(unit: Path, tmp_path: Path) -> None:
    text = unit.read_text()
    assert verify(tmp_path, unit, text) == ""
    assert "Unknown key" in verify(tmp_path, unit, text.replace("KillMode", "KilMode", 1) + "X=1\n")


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.stem)
def test_units_are_hardened(unit: Path, tmp_path: Path) -> None:
    limits = ("--offline=true", f"--threshold={MAX_EXPOSURE}")
    done = analyze("security", *limits, unit)
    assert done.returncode == 0, done.stdout[-300:]
    bare = tmp_path / unit.name
    bare.write_text(re.sub(r"\nNoNewPrivileges.*\n\n", "\n\n", unit.read_text(), flags=re.DOTALL))
    assert analyze("security", *limits, bare).returncode != 0


def test_a_guard_outlives_its_executive() -> None:
    executive = Unit(FOLDER / "rover-executive@.service").values
    assert executive["KillMode"] == ["control-group"]
    assert executive["WatchdogSignal"] == ["SIGTERM"]
    assert executive["OOMPolicy"] == ["continue"]


@contextmanager
def manager(folder: Path, patch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    """Give the socket of a service manager."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as end:
        end.settimeout(LIMIT_S)
        end.bind(str(folder / "notify"))
        patch.setenv("NOTIFY_SOCKET", str(folder / "notify"))
        yield end


@pytest.mark.parametrize("name", ["", "@rover-test", "/nowhere/notify"])
def test_no_service_manager_is_no_error(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", name)
    notify(ALIVE)


def test_a_process_that_serves_is_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with manager(tmp_path, monkeypatch) as end:
        announce("x listens")
        assert end.recv(100) == b"READY=1\nSTATUS=x listens"
    assert capsys.readouterr().out == "x listens\n"


def test_a_full_queue_of_the_manager_delays_readiness_but_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with manager(tmp_path, monkeypatch) as end, ExitStack() as stack:
        for _ in range(100):  # a queue has space for some messages of each sender
            sender = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            sender.setblocking(False)
            with suppress(BlockingIOError):
                while True:
                    sender.sendto(b"", str(tmp_path / "notify"))
        notify(ALIVE)
        announce("x listens")
        time.sleep(0.1)
        assert next(filter(None, iter(lambda: end.recv(100), None))) == b"READY=1\nSTATUS=x listens"


@pytest.mark.parametrize(
    ("timeout_us", "of", "period_s"),
    [("20000000", "", 10.0), ("20000000", "1", None), ("0", "", None), ("", "", None)],
)
def test_heartbeats_are_those_of_the_unit(
    timeout_us: str, of: str, period_s: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", timeout_us)
    monkeypatch.setenv("WATCHDOG_PID", of or str(os.getpid()))
    assert watchdog_period_s() == period_s


@contextmanager
def service(
    unit: Path, folder: Path, settings: str, patch: pytest.MonkeyPatch
) -> Iterator[tuple[subprocess.Popen[bytes], socket.socket]]:
    """Run the command line of a unit with its environment alone, confined by its keys."""
    unit_file, prefix, settings_folder = Unit(unit), folder / "current", folder / "etc"
    prefix.mkdir()
    (prefix / "bin").symlink_to(Path(sys.executable).parent)
    settings_folder.mkdir()
    shutil.copy(FOLDER / "rover.env", settings_folder)
    domain = f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}\nFASTDDS_BUILTIN_TRANSPORTS=\n"
    (settings_folder / "jackal.env").write_text(
        f"{domain}ROVER_CONFIG={os.environ['ROVER_CONFIG']}\n{settings}\n"
    )
    (folder / "limits.json").write_text(json.dumps(unit_file.limits()))
    with manager(folder, patch) as end:
        environment = {
            "PATH": "/usr/bin:/bin",
            "NOTIFY_SOCKET": str(folder / "notify"),
            "STATE_DIRECTORY": str(folder / "state"),
            "WATCHDOG_USEC": "400000",
            "PYTHONPATH": str(CHECKOUT),
            **unit_file.environment("jackal", settings_folder),
        }
        confined = (sys.executable, "-m", "tests.support.confined", str(folder / "limits.json"))
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(
                [*confined, *unit_file.command("jackal", prefix)],
                cwd="/", env=environment, stdout=log, stderr=log,
            )  # fmt: skip
        try:
            yield process, end
        finally:
            process.kill()
            process.wait()


@pytest.mark.ros
def test_the_executive_runs_as_its_unit(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert ros_domain
    unit = FOLDER / "rover-executive@.service"
    options = "EXECUTIVE_OPTIONS=--port 0 --log-level warning"
    with service(unit, tmp_path, options, monkeypatch) as (process, manager):
        ready = manager.recv(1000).decode()
        assert (found := re.fullmatch(r"READY=1\nSTATUS=jackal listens at (\S+)", ready)), ready
        assert manager.recv(100) == manager.recv(100) == b"WATCHDOG=1"
        assert call_ground(found[1], MrsClient.get_status) is not None
        assert (tmp_path / "state" / "ledger.sqlite").exists()
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT_S) == 0, (tmp_path / "log").read_text()


@pytest.mark.ros
def test_the_relay_runs_as_its_unit(
    ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    relay = tmp_path / "relay.yaml"
    text = (CHECKOUT / "config" / "jackal.relay.yaml").read_text()
    relay.write_text(text.replace("1114", str(port_of(ros_domain))))
    options = f"RELAY_OPTIONS=--config {relay}"
    unit = FOLDER / "rover-relay@.service"
    with service(unit, tmp_path, options, monkeypatch) as (process, manager):
        assert manager.recv(1000).startswith(b"READY=1\nSTATUS=ipn:")
        process.send_signal(signal.SIGTERM)
        assert process.wait(LIMIT_S) == 0, (tmp_path / "log").read_text()
