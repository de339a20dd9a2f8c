"""Names a missing optional package, with the extra that installs it."""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final

DISTRIBUTION: Final = "rover-executive"
EXTRAS: Final = {
    "mujoco": "sim",
    "matplotlib": "sim",
    "numpy": "sim",
    "PIL": "onboard",
    "usb": "onboard",
    "OpenGL": "gl",
    "casadi": "mpc",
    "cryptography": "bpsec",
    "dask": "campaign",
    "distributed": "campaign",
    "jinja2": "campaign",
    "pandas": "campaign",
    "pyarrow": "campaign",
    "rosbags": "campaign",
    "scipy": "campaign",
    "aiohttp": "ground",
    "alembic": "ground",
    "markdown_it": "ground",
    "prometheus_client": "onboard",  # the extra ground has it, too
    "sqlalchemy": "ground",
    "psycopg": "postgresql",
}
"""Optional packages, and the extra of this distribution that installs each."""
_NO_ROS: Final = (
    "ROS 2 is not installed here. On Linux x86_64 `./rover` and the extra ros include it; on other"
    " systems install ROS 2 Jazzy or newer and source its setup.sh first."
)


def program() -> str:
    """Return how to type `rover`: with the launcher in an environment that the launcher made."""
    return "./rover" if Path(sys.prefix, "rover-stamp").is_file() else "rover"


def require(package: str) -> None:
    """Raise ModuleNotFoundError unless a package can be imported.

    Raises:
        ModuleNotFoundError: it cannot; `missing_package` has a text for it.
    """
    if find_spec(package) is None:
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)


def missing_package(error: ImportError) -> str | None:
    """Return how to install the optional package that an import lacks; None for other errors."""
    package = (error.name or "").partition(".")[0]
    if not isinstance(error, ModuleNotFoundError):
        return None
    if package == "rclpy" or package.endswith(("_msgs", "_srvs", "_interfaces")):
        return _NO_ROS
    extra = EXTRAS.get(package)
    if extra is None:
        return None
    return (
        f"{package} is not installed here: pip install '{DISTRIBUTION}[{extra}]', or in a checkout"
        " ./rover extras"
    )
