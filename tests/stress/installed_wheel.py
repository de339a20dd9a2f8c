"""The wheel without a checkout: installed as `docs/installation.md` says, used in an empty folder.

It needs the package index, so that it is no part of the suite: `rover test --stress` runs it.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.docs.pages import blocks
from tests.support.processes import Running
from tests.support.wheel import CHECKOUT, build_wheel

PAGE = CHECKOUT / "docs" / "installation.md"
LIMIT_S = 600.0
MPC = "--set settings.mpc.selectable=true --set command.go.controller=mpc"
UNSET = ("PYTHONPATH", "VIRTUAL_ENV", "ROVER_CONFIG", "ROVER_DATA")


@dataclass(frozen=True, slots=True)
class Installation:
    """An environment with the wheel, and an empty folder to use it in."""

    scripts: Path
    folder: Path

    def run(self, script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
        return run(self.folder, str(self.scripts / script), *arguments)


def run(folder: Path, *command: str, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in UNSET}
    return subprocess.run(
        command,
        cwd=folder,
        env=environment | variables,
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("built"))


@pytest.fixture(scope="module")
def installation(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Installation]:
    """Install the wheel and what the lock has, into an environment of its own."""
    home = tmp_path_factory.mktemp("home")
    run(home, sys.executable, "-m", "venv", "env").check_returncode()
    pip = (str(home / "env" / "bin" / "pip"), "install", "--no-deps")
    locked = (
        "--require-hashes",
        "--only-binary",
        ":all:",
        "-r",
        str(CHECKOUT / "requirements.lock"),
    )
    for options in (locked, ("--no-index", str(wheel))):
        done = run(home, *pip, *options)
        assert done.returncode == 0, done.stderr
    (home / "empty").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        for name in UNSET:
            patch.delenv(name, raising=False)
        yield Installation(home / "env" / "bin", home / "empty")


def test_the_demonstration_meets_its_expectations(installation: Installation) -> None:
    done = installation.run("rover", "demo")
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    (folder,) = (installation.folder / "runs").iterdir()
    assert {"map.png", "tree.svg"} <= {path.name for path in folder.iterdir()}
    assert "http://127.0.0.1:" in done.stdout


def test_a_scenario_is_played_and_plotted(installation: Installation) -> None:
    done = installation.run("rover", "scenario", "drive3m_turn_picture", "--out", "scenario")
    assert done.returncode == 0, f"{done.stdout}{done.stderr}"
    assert list((installation.folder / "scenario").rglob("run.mcap"))


def test_the_console_serves_its_pages_and_the_help(installation: Installation) -> None:
    command = (str(installation.scripts / "rover-console"), "--port", "0", "--data", "console")
    console = Running(installation.folder / "log", *command, cwd=installation.folder)
    try:
        address = console.output(r"(http://127\.0\.0\.1:\d+/)")
        for path in ("", "lite", "help/installation.md", "api/dictionary"):
            with urllib.request.urlopen(address + path, timeout=LIMIT_S) as answer:
                assert answer.status == 200
                assert answer.read()
        assert console.end(signal.SIGINT) in (0, 130)
    finally:
        console.clean_up()


@pytest.mark.parametrize(
    ("typed", "extra"),
    [("campaign normal --runs 2", "campaign"), (f"scenario to_a_goal {MPC}", "mpc")],
)
def test_a_missing_package_is_named_with_its_extra(
    typed: str, extra: str, installation: Installation
) -> None:
    done = installation.run("rover", *typed.split())
    assert done.returncode in (1, 2)
    assert f"pip install 'rover-executive[{extra}]', or in a checkout ./rover extras" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_foreign_distribution_in_the_environment_is_named(installation: Installation) -> None:
    (site,) = installation.scripts.parent.glob("lib/python*/site-packages")
    other = site / "other-1.0.dist-info"
    other.mkdir()
    try:
        (other / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 1.0\n")
        (other / "RECORD").write_text("sim/__init__.py,,\n")
        for script in ("rover", "rover-executive"):
            done = installation.run(script, "--version" if script == "rover" else "--help")
            assert done.returncode == 1
            assert done.stderr.startswith("Error: other 1.0 has installed files into ")
    finally:
        shutil.rmtree(other)


@pytest.fixture(scope="module")
def tools(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with pipx and uv."""
    home = tmp_path_factory.mktemp("tools")
    run(home, sys.executable, "-m", "venv", "env").check_returncode()
    scripts = home / "env" / "bin"
    done = run(home, str(scripts / "pip"), "install", "pipx", "uv")
    assert done.returncode == 0, done.stderr
    return scripts


def test_the_commands_of_the_page_install(wheel: Path, tools: Path, tmp_path: Path) -> None:
    (tmp_path / "dist").mkdir()
    shutil.copy(wheel, tmp_path / "dist")
    shutil.copy(CHECKOUT / "requirements.lock", tmp_path)
    building, *installing = blocks(PAGE, "bash")
    assert "pip wheel" in building  # `build_wheel` does that in a copy
    bin_folder = tmp_path / "bin"
    path = os.pathsep.join((str(bin_folder), str(tools), os.environ["PATH"]))
    variables = {"PATH": path, "HOME": str(tmp_path), "PIPX_HOME": str(tmp_path / "pipx")}
    variables |= dict.fromkeys(("PIPX_BIN_DIR", "UV_TOOL_BIN_DIR"), str(bin_folder))
    variables |= {"UV_TOOL_DIR": str(tmp_path / "uv"), "UV_CACHE_DIR": str(tmp_path / "cache")}
    for block in installing:
        done = run(tmp_path, "sh", "-euxc", block, **variables)
        assert done.returncode == 0, f"{done.stdout}{done.stderr}"
        assert re.search(r"^rover \d+\.\d+", done.stdout, re.MULTILINE)
