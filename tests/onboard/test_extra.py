"""What is aboard needs no package but those of the extra `onboard`, with the controller mpc."""

import sys
import tomllib
from collections.abc import Iterable
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, packages_distributions, requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from adapters.mrs.ground import MrsClient
from tests.support.ground import call_ground
from tests.support.processes import LISTENS, Running

CHECKOUT = Path(__file__).resolve().parents[2]
ABOARD = ("adapters.onboard", "adapters.bundle", "adapters.mocup", "adapters.mrs.aboard",
          "adapters.mrs.link", "adapters.relay.rover", "adapters.ros", "adapters.video",
          "executive")  # fmt: skip
CODE = """
import importlib, pkgutil, sys

sys.modules |= dict.fromkeys({missing!r})
for name in {aboard!r}:
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(getattr(package, "__path__", ()), name + "."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
from adapters.onboard.process import main
main()
"""


def with_dependencies(lines: Iterable[str]) -> set[str]:
    """Return the distributions that are asked for, and all that those installed ask for."""
    found: set[str] = set()
    wanted = [Requirement(line) for line in lines]
    while wanted:
        requirement = wanted.pop()
        name = canonicalize_name(requirement.name)
        if name not in found and (not requirement.marker or requirement.marker.evaluate()):
            found.add(name)
            with suppress(PackageNotFoundError):
                wanted += map(Requirement, requires(name) or ())
    return found


@pytest.mark.ros
def test_an_executive_starts_with_the_packages_of_its_extra(
    ros_domain: int, patient: Path, tmp_path: Path
) -> None:
    assert ros_domain
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    aboard = with_dependencies([*project["dependencies"], *extras["onboard"], *extras["mpc"]])
    others = with_dependencies(
        line for name, lines in extras.items() if name != "ros" for line in lines
    )
    missing = {
        module
        for module, distributions in packages_distributions().items()
        if others & (names := {canonicalize_name(name) for name in distributions})
        and not aboard & names
    }
    assert {"matplotlib", "mujoco", "pandas", "pyarrow", "pytest"} <= missing
    asset = tmp_path / "rover.yaml"
    jackal = (patient / "jackal.yaml").read_text()
    asset.write_text(jackal.replace("controller: turn_drive", "controller: mpc"))
    code = CODE.format(missing=missing, aboard=ABOARD)
    options = ("--asset", str(asset), "--port", "0", "--data", str(tmp_path / "data"))
    process = Running(tmp_path / "log", sys.executable, "-c", code, *options)
    try:
        assert call_ground(process.output(LISTENS), MrsClient.get_status) is not None
        assert process.end() == 0
    finally:
        process.clean_up()
