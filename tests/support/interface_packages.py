"""Packages of ROS interfaces that the wheels lack, built once per version of Python and of ROS.

`tests/support/definitions` has the definitions, with the fields of the packages from apt: a folder
for Jazzy, and one with what differs in Kilted.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from fcntl import LOCK_EX, flock
from hashlib import sha256
from importlib.metadata import distributions
from pathlib import Path
from typing import Final

import pytest

from tests.suite import CHECKOUT
from tests.support import message_builder

DEFINITIONS: Final = Path(__file__).with_name("definitions")
JAZZY, KILTED = "jazzy", "kilted"
REQUIRED: Final = "ROVER_CI" in os.environ
LIMIT_S: Final = 600.0


def installed() -> str:
    """Return the distribution of the installed rclpy."""
    newer = any(each.name.startswith("ros-kilted") for each in distributions())
    return KILTED if newer else JAZZY


def interface_package(name: str, distribution: str | None = None) -> Path | None:
    """Return the folder for PYTHONPATH that has a package; None if Python finds it without one.

    Skips the test where it cannot be built, and fails it in CI.

    Args:
        name: as `nav2_msgs`.
        distribution: that of the definitions; None for the installed package or distribution.
    """
    if distribution is None and _is_installed(name):
        return None
    if (lacking := message_builder.missing()) is not None:
        (pytest.fail if REQUIRED else pytest.skip)(f"{name}: {lacking}")
    definitions = _definitions(name, distribution or installed())
    folder = _cache() / f"{name}-{_digest(definitions)}"
    with _locked(folder.with_suffix(".lock")):
        if not folder.is_dir():
            _build(definitions, folder)
    return folder


def python_path(*folders: Path | None) -> str:
    """Return a PYTHONPATH for processes of this checkout, with folders of packages before it."""
    found = [str(each) for each in folders if each is not None]
    inherited = filter(None, [os.environ.get("PYTHONPATH")])
    return os.pathsep.join([*found, str(CHECKOUT), *inherited])


def _is_installed(name: str) -> bool:
    spec = importlib.util.find_spec(name)
    built = spec is not None and str(_cache()) in str(spec.origin)
    return spec is not None and not built


def _definitions(name: str, distribution: str) -> dict[str, str]:
    """Return the text of each definition, by its path from the folder of all packages."""
    found = {}
    for each in dict.fromkeys((JAZZY, distribution)):
        folder = DEFINITIONS / each
        for path in sorted((folder / name).rglob("*.*")):
            found[str(path.relative_to(folder))] = path.read_text()
    assert found, f"no definitions of {name}"
    return found


def _digest(definitions: dict[str, str]) -> str:
    """Return a digest of everything that the libraries depend on."""
    versions = sorted(
        f"{each.name} {each.version}" for each in distributions() if each.name.startswith("ros-")
    )
    builder = Path(message_builder.__file__).read_text()
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    text = repr((sorted(definitions.items()), versions, builder, suffix))
    return sha256(text.encode()).hexdigest()[:16]


def _cache() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rover-executive-tests"


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Let one of all test processes build."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w") as file:
        flock(file, LOCK_EX)
        yield


def _build(definitions: dict[str, str], folder: Path) -> None:
    """Build in a process of its own; the folder appears when it is complete."""
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        source, out = Path(scratch) / "definitions", Path(scratch) / "out"
        for name, text in definitions.items():
            path = source / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        module = ("-m", "tests.support.message_builder", str(source), str(out))
        done = subprocess.run(
            (sys.executable, *module),
            cwd=CHECKOUT,
            capture_output=True,
            text=True,
            timeout=LIMIT_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        shutil.move(out, folder)
