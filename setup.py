"""Declares to setuptools the keys that colcon reads here; pyproject.toml has their values."""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent  # colcon build --symlink-install calls it by a link
SHARE = "share/rover_executive"
TOP_LEVEL = ("executive", "trees", "adapters", "sim")

project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def scripts(table: dict[str, str]) -> list[str]:
    return [f"{name} = {target}" for name, target in table.items()]


def data_files() -> list[tuple[str, list[str]]]:
    """List where colcon and pip put all but modules: the ament marker, config/, docs/, launch/."""
    files = [
        ("share/ament_index/resource_index/packages", ["resource/rover_executive"]),
        (SHARE, ["package.xml"]),
    ]
    config = ROOT / "config"
    inside = sorted(path for path in config.rglob("*") if path.is_dir())
    docs = ROOT / "docs"
    for folder in [config, *inside, docs, docs / "images", ROOT / "launch"]:
        names = sorted(str(path.relative_to(ROOT)) for path in folder.iterdir() if path.is_file())
        files.append((f"{SHARE}/{folder.relative_to(ROOT)}", names))
    return files


setup(
    name=project["name"],
    version=project["version"],
    license="Apache-2.0",
    python_requires=">=3.11",
    packages=find_packages(include=[*TOP_LEVEL, *(f"{name}.*" for name in TOP_LEVEL)]),
    py_modules=[project["name"].replace("-", "_")],
    data_files=data_files(),
    entry_points={
        "console_scripts": scripts(project["scripts"]),
        **{group: scripts(table) for group, table in project["entry-points"].items()},
    },
)
