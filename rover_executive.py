"""Entry points of all scripts: each checks first that the packages are those of this distribution.

Other projects on PyPI use our package names. A script ends with an error if Python finds one of the
packages at another path, or if another distribution has files in one of them. This module has a
name of its own, so that it runs even if all packages are another's.
"""

import sys
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Final

DISTRIBUTION: Final = "rover-executive"
ROOT: Final = Path(__file__).resolve().parent
OWN_PACKAGES: Final = ("executive", "trees", "adapters", "sim")


class ForeignPackageError(ImportError):
    """One of the packages is another distribution's; the text names that and the remedy."""


def check_own_packages() -> None:
    """Check that the packages are complete, and ours alone.

    Raises:
        ForeignPackageError: Python finds one of the packages at another path than this module, or
            another distribution has installed files into one.
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
    for record in ROOT.glob("*.dist-info/RECORD"):  # importlib.metadata takes twice as long
        name, _, version = record.parent.stem.partition("-")
        files = b"\n"
        with suppress(OSError):  # it may be uninstalled now
            files += record.read_bytes()
        found = [each for each in OWN_PACKAGES if f"\n{each}/".encode() in files]
        if found and name.replace("_", "-").lower() != DISTRIBUTION:
            raise ForeignPackageError(
                f"{name} {version} has installed files into {ROOT / found[0]}, a package of"
                f" {DISTRIBUTION}, and may have overwritten some: uninstall both, then install"
                f" {DISTRIBUTION} into an environment of its own"
            )


def _run(module: str) -> None:
    try:
        check_own_packages()
    except ForeignPackageError as error:
        sys.exit(f"Error: {error}")
    from adapters.process.start import missing_package

    try:
        process = import_module(module)
    except ImportError as error:
        text = missing_package(error)
        if text is None:
            raise
        sys.exit(f"Error: {text}")
    process.main()


rover = partial(_run, "adapters.cli.main")
console = partial(_run, "adapters.console.process")
executive = partial(_run, "adapters.onboard.process")
simulation = partial(_run, "sim.ros.process")
orbiter = partial(_run, "adapters.relay.orbiter.process")
relay = partial(_run, "adapters.relay.rover.process")
brick = partial(_run, "adapters.mocup.brick.process")
