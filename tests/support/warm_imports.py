"""What processes of ours import, imported once: `warm.py` forks them from here."""

import gc
from contextlib import suppress
from importlib import import_module
from typing import Final

PROCESSES: Final = (
    "adapters.onboard.service",
    "sim.ros.service",
    "adapters.relay.orbiter.process",
    "adapters.relay.rover.process",
    "adapters.console.service",
    "adapters.mocup.brick.process",
    "adapters.mocup.brick.service",
    "sim.brick.nxt",
    "adapters.ros.check",
    "adapters.cli.robot",
    "tests.robots.standin",
)

for _name in PROCESSES:
    with suppress(ImportError):  # what is not installed here, its tests do without
        import_module(_name)
gc.collect()
gc.freeze()
