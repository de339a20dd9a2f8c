"""Imports between packages: the contracts hold, and they fail where one is broken."""

import shutil
import sys
from pathlib import Path

import pytest

from tests.support.processes import run_to_end

CHECKOUT = Path(__file__).resolve().parents[2]
PACKAGES = ("executive", "trees", "adapters", "sim")
LINT = Path(sys.executable).with_name("lint-imports")

WALK_CORE = """
import importlib, pkgutil, sys
for name in ("rclpy", "std_msgs", "mujoco", "numpy", "PIL", "aiohttp"):
    sys.modules[name] = None
for name in ("executive", "trees"):
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, name + "."):
        importlib.import_module(module.name)
        print(module.name)
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copy(CHECKOUT / "pyproject.toml", tmp_path)
    for package in PACKAGES:
        shutil.copytree(
            CHECKOUT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    contract = Path("tests/architecture/public_api.py")
    (tmp_path / contract.parent).mkdir(parents=True)
    shutil.copy(CHECKOUT / contract, tmp_path / contract)
    return tmp_path


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("executive/values/reasons.py", "import trees", "Layers import downward only"),
        ("executive/state/slip.py", "import executive.core.inbox", "Layers of the core"),
        ("sim/drawing/run_plot.py", "import executive.core.recording", "Runs are read through"),
        ("adapters/cli/main.py", "import tests.stress", "Product code does not import tests"),
        ("trees/leaf.py", "import rclpy", "The core imports no ROS"),
        ("executive/values/reasons.py", "import socket", "The core imports no ROS"),
        ("trees/leaf.py", "import time", "The core has no locks"),
        ("adapters/mal/errors.py", "import py_trees", "py_trees is imported by trees only"),
        ("adapters/mal/errors.py", "import adapters.mrs", "Adapters of different kinds"),
        ("adapters/ros/node.py", "import adapters.mrs", "Adapters of different kinds"),
        (
            "adapters/bundle/codec/errors.py",
            "import cattrs",
            "The bundle agent imports",
        ),
        (
            "adapters/bundle/codec/errors.py",
            "import adapters.bundle.links.contact",
            "Layers of the bundle agent",
        ),
        ("trees/leaf.py", "import executive.record.ledger", "Packages are imported through"),
        ("trees/leaf.py", "from trees import RoverTree", "Packages are imported through"),
        ("executive/state/status.py", "import executive.motion", "Packages are not imported"),
    ],
)
def test_a_forbidden_import_is_found(copy: Path, module: str, line: str, contract: str) -> None:
    path = copy / module
    path.write_text(path.read_text() + f"\n{line}\n")
    found = run_to_end(LINT, "--no-cache", cwd=copy)
    assert found.returncode == 1, found.stdout
    broken = [row for row in found.stdout.splitlines() if " BROKEN" in row]
    assert any(row.startswith(contract) for row in broken), found.stdout


def test_the_contracts_hold(copy: Path) -> None:
    found = run_to_end(LINT, "--no-cache", cwd=copy)
    assert found.returncode == 0, found.stdout
    assert "0 broken" in found.stdout


def test_core_imports_where_nothing_else_is_installed() -> None:
    walked = run_to_end(sys.executable, "-c", WALK_CORE, cwd=CHECKOUT)
    assert walked.returncode == 0, walked.stderr
    assert {"executive.commands.intake", "trees.rover"} <= set(walked.stdout.split())


def test_a_mere_client_of_a_rover_does_not_wait_for_the_core_to_be_imported() -> None:
    """The start of each `rover` command consists of imports."""
    heavy = {"executive.core", "executive.motion", "executive.record", "executive.safety", "trees"}
    requested = f"import sys, adapters.mrs.ground; print({heavy} & sys.modules.keys())"
    assert run_to_end(sys.executable, "-c", requested, cwd=CHECKOUT).stdout == "set()\n"


MAX_LINES = 600
GENERATED = ", generated " + "from "


def test_no_file_is_too_long() -> None:
    lengths = {
        str(path.relative_to(CHECKOUT)): len(path.read_text().splitlines())
        for package in (*PACKAGES, "tests")
        for path in (CHECKOUT / package).rglob("*.py")
        if GENERATED not in path.read_text()
    }
    assert {path: lines for path, lines in lengths.items() if lines > MAX_LINES} == {}


def test_every_package_has_a_page() -> None:
    """What a package below is for is in the docstring of its `__init__` (ruff, D104)."""
    packages = (*PACKAGES, "config", "tests")
    assert [
        package for package in packages if not (CHECKOUT / package / "README.md").is_file()
    ] == []
