"""Start of every process: checks the dependencies before their import, and names a missing package.

Other projects on PyPI use our package names. A process ends with an error at start if Python finds
one of our packages at another path. It warns if another distribution has files in one of them.
A missing package is named with the extra that installs it.
"""

import re
import sys
from collections.abc import Iterator
from functools import partial
from importlib import import_module
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Final

DISTRIBUTION: Final = "rover-executive"
ROOT: Final = Path(__file__).resolve().parents[2]
OWN_PACKAGES: Final = ("executive", "trees", "adapters", "sim")
EXTRAS: Final = {
    "mujoco": "sim",
    "matplotlib": "sim",
    "numpy": "sim",
    "PIL": "camera",
    "usb": "nxt",
    "OpenGL": "gl",
    "distributed": "campaign",
    "jinja2": "campaign",
    "pandas": "campaign",
    "pyarrow": "campaign",
    "aiohttp": "console",
    "alembic": "console",
    "sqlalchemy": "console",
    "psycopg": "postgresql",
    "scipy": "campaign",
}
"""Optional packages, and the extra of this distribution that installs each."""
_NO_ROS: Final = (
    "ROS 2 is not installed here. On Linux x86_64 `./rover` includes it; on other systems install"
    " ROS 2 Jazzy or newer and source its setup.sh first."
)


class ForeignPackageError(ImportError):
    """One of the packages is another distribution's; the text names that and the remedy."""


def require(package: str) -> None:
    """Raise ModuleNotFoundError unless a package can be imported.

    Raises:
        ModuleNotFoundError: it cannot; `missing_package` has a text for it.
    """
    if find_spec(package) is None:
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)


def missing_package(error: ImportError) -> str | None:
    """Return how to install the optional package that an import lacks; None for other errors."""
    if isinstance(error, ForeignPackageError):
        return str(error)
    package = (error.name or "").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError):
        return None
    if package == "rclpy" or package.endswith(("_msgs", "_srvs", "_interfaces")):
        return _NO_ROS
    extra = EXTRAS.get(package)
    if extra is None:
        return None
    return f"{package} is not installed here: pip install '{DISTRIBUTION}[{extra}]'"


def check_own_packages() -> Iterator[str]:
    """Yield a warning for each other distribution with files in a package of this one.

    Raises:
        ForeignPackageError: Python finds one of the packages at another path than this module.
    """
    for package in OWN_PACKAGES:
        spec = find_spec(package)
        where = Path(spec.origin).resolve().parent if spec is not None and spec.origin else None
        if where != ROOT / package:
            raise ForeignPackageError(
                f"Python finds package {package} at {where}, and not at {ROOT / package}: uninstall"
                " the pip package that contains it, or remove it from PYTHONPATH;"
                f" {DISTRIBUTION} needs an environment of its own"
            )
    files = re.compile(rf"^({'|'.join(OWN_PACKAGES)})/", re.MULTILINE)
    for distribution in distributions(path=[str(ROOT)]):
        found = files.search(distribution.read_text("RECORD") or "")
        if found and distribution.name.replace("_", "-").lower() != DISTRIBUTION:
            yield (
                f"{distribution.name} {distribution.version} has installed files into"
                f" {ROOT / found[1]}, a package of {DISTRIBUTION}: install them into two"
                " environments, for either may have overwritten the other"
            )


def _run_module(module: str) -> None:
    try:
        for warning in check_own_packages():
            print(f"Warning: {warning}", file=sys.stderr)
        process = import_module(module)
    except ImportError as error:
        text = missing_package(error)
        if text is None:
            raise
        sys.exit(f"Error: {text}")
    process.main()


console = partial(_run_module, "adapters.console.process")
executive = partial(_run_module, "adapters.onboard.process")
simulation = partial(_run_module, "sim.ros.process")
orbiter = partial(_run_module, "adapters.relay.orbiter.process")
relay = partial(_run_module, "adapters.relay.rover.process")
brick = partial(_run_module, "adapters.mocup.brick.process")
