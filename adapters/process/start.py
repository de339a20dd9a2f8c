"""The console scripts of the processes: what they stand on is checked before it is imported."""

import sys
from importlib import import_module

from adapters.process.packages import check_own_packages, missing_package


def executive() -> None:
    """Run `rover-executive`."""
    _run("adapters.onboard.process")


def simulation() -> None:
    """Run `rover-sim`."""
    _run("sim.ros.process")


def orbiter() -> None:
    """Run `rover-mops`."""
    _run("adapters.relay.orbiter.process")


def relay() -> None:
    """Run `rover-relay`."""
    _run("adapters.relay.rover.process")


def brick() -> None:
    """Run `rover-nxt`."""
    _run("adapters.mocup.brick.process")


def _run(module: str) -> None:
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
