"""The process `rover robot check` beside the process of a robot, and files of assets to check."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from tests.robots.test_robots import module
from tests.suite import CHECKOUT
from tests.support.processes import Running

COMMAND: Final = "adapters.cli.robot:robot"


@contextmanager
def standin(folder: Path, name: str) -> Iterator[Running]:
    with module(folder / "robot.log", "tests.robots.standin", name) as process:
        process.output("is there")
        yield process


@contextmanager
def checking(folder: Path, asset: str, *options: str) -> Iterator[Running]:
    # A lost announcement of a publisher is repeated after 3 s, and again after 3 s.
    arguments = ("check", asset, "--seconds", "8", *options)
    process = Running(folder / f"check-{time.monotonic_ns()}.log", COMMAND, *arguments)
    try:
        yield process
    finally:
        process.clean_up()


def checked(folder: Path, asset: str, *options: str) -> dict[str, Any]:
    with checking(folder, asset, "--json", *options) as process:
        process.ended()
        lines = process.text.splitlines()
    assert lines[-1].startswith("{"), process.text
    found: dict[str, Any] = json.loads(lines[-1])
    return found


def edited(folder: Path, robot: str, *changes: tuple[str, str]) -> str:
    """Return an asset file of a robot, with other lines in its ROS parameters."""
    source = CHECKOUT / "config" / "robots"
    text = (source / f"{robot}.ros.yaml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / f"{robot}.ros.yaml").write_text(text, encoding="utf-8")
    asset = folder / f"{robot}.yaml"
    asset.write_bytes((source / asset.name).read_bytes())
    return str(asset)
