"""The arrows between the rooms: the contracts hold, and they do fail where one is broken."""

import shutil
import sys
from pathlib import Path

import pytest

from tests.support.processes import run_to_end

CHECKOUT = Path(__file__).resolve().parents[2]
ROOMS = ("executive", "trees", "adapters", "sim")
LINT = Path(sys.executable).with_name("lint-imports")

WALK_CORE = """
import importlib, pkgutil, sys
for name in ("rclpy", "std_msgs", "mujoco", "numpy", "PIL", "aiohttp"):
    sys.modules[name] = None
for room in ("executive", "trees"):
    package = importlib.import_module(room)
    for module in pkgutil.walk_packages(package.__path__, room + "."):
        importlib.import_module(module.name)
        print(module.name)
"""


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    shutil.copy(CHECKOUT / "pyproject.toml", tmp_path)
    for room in ROOMS:
        shutil.copytree(
            CHECKOUT / room, tmp_path / room, ignore=shutil.ignore_patterns("__pycache__")
        )
    contract = Path("tests/architecture/faces.py")
    (tmp_path / contract.parent).mkdir(parents=True)
    shutil.copy(CHECKOUT / contract, tmp_path / contract)
    return tmp_path


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("executive/values/reasons.py", "import trees", "Arrows point one way"),
        ("executive/state/slip.py", "import executive.core.inbox", "The packages of the core"),
        ("sim/plot/recorded.py", "import executive.core.recording", "What happened in a run"),
        ("adapters/cli/main.py", "import tests.stress", "The product knows nothing of its tests"),
        ("trees/leaf.py", "import rclpy", "The core knows no ROS"),
        ("executive/values/reasons.py", "import socket", "The core knows no ROS"),
        ("trees/leaf.py", "import time", "The core takes no lock"),
        ("adapters/mal/errors.py", "import py_trees", "py_trees lives in trees only"),
        ("adapters/mal/errors.py", "import adapters.mrs", "Adapters of different kinds"),
        ("adapters/ros/node.py", "import adapters.mrs", "Adapters of different kinds"),
        (
            "adapters/bundle/codec/errors.py",
            "import cattrs",
            "The bundle agent stands on the standard",
        ),
        (
            "adapters/bundle/codec/errors.py",
            "import adapters.bundle.links.contact",
            "The folders of the bundle agent",
        ),
        ("trees/leaf.py", "import executive.record.ledger", "Nobody reaches past the face"),
        ("trees/leaf.py", "from trees import RoverTree", "Nobody reaches past the face"),
        ("executive/state/status.py", "import executive.motion", "Folders do not import each"),
    ],
)
def test_a_broken_arrow_is_found(copy: Path, module: str, line: str, contract: str) -> None:
    path = copy / module
    path.write_text(path.read_text() + f"\n{line}\n")
    found = run_to_end(LINT, "--no-cache", cwd=copy)
    assert found.returncode == 1, found.stdout
    broken = [row for row in found.stdout.splitlines() if " BROKEN" in row]
    assert any(row.startswith(contract) for row in broken), found.stdout


def test_the_arrows_hold(copy: Path) -> None:
    found = run_to_end(LINT, "--no-cache", cwd=copy)
    assert found.returncode == 0, found.stdout
    assert "0 broken" in found.stdout


def test_core_imports_where_nothing_else_is_installed() -> None:
    walked = run_to_end(sys.executable, "-c", WALK_CORE, cwd=CHECKOUT)
    assert walked.returncode == 0, walked.stderr
    assert {"executive.commands.intake", "trees.rover"} <= set(walked.stdout.split())


MOST_LINES = 600
GENERATED = ", generated " + "from "


def test_no_file_is_too_long() -> None:
    lengths = {
        str(path.relative_to(CHECKOUT)): len(path.read_text().splitlines())
        for room in (*ROOMS, "tests")
        for path in (CHECKOUT / room).rglob("*.py")
        if GENERATED not in path.read_text()
    }
    assert {path: lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def test_every_room_has_a_page() -> None:
    """What a package below is for is in the docstring of its `__init__` (ruff, D104)."""
    rooms = (*ROOMS, "config", "tests")
    assert [room for room in rooms if not (CHECKOUT / room / "README.md").is_file()] == []
