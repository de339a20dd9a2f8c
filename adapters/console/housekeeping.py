"""`ConsoleHousekeeping` publishes the console's own health figures as an asset that is no rover."""

import asyncio
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Final

from adapters.console.archive import Archive
from adapters.console.messages import LinkKind, Quality, Sample
from adapters.console.rovers import AssetEntry, parameter_entries
from adapters.console.web import Hub
from adapters.mrs.spec import CONSOLE, CONSOLE_HOUSEKEEPING, usage_figures
from adapters.process import ResourceMonitor
from adapters.system import System

ASSET: Final = "rover-console"
"""Name of the console's asset. It is no valid ROS name, so no rover can have it."""
EVERY_S: Final = 5.0


class ConsoleHousekeeping:
    """Measures the console and publishes the figures as telemetry.

    Args:
        archive: its queue of messages is measured.
        hub: its open pages are counted.
        data: data folder of the console.
        sample: publishes a telemetry value.
        system: clock and resource usage.

    Attributes:
        figures: last figures, by the names of `CONSOLE_HOUSEKEEPING`.
    """

    def __init__(
        self,
        archive: Archive,
        hub: Hub,
        data: Path,
        sample: Callable[[Sample], None],
        system: System,
    ) -> None:
        self._archive, self._hub, self._sample = archive, hub, sample
        self._utc, self._usage = system.utc_s, ResourceMonitor(data, system)
        self.figures: dict[str, float | None] = {}
        self._before = (asyncio.get_running_loop().time(), 0)
        self.entry = AssetEntry(
            asset=ASSET,
            description="This operations console",
            version=version("rover-executive"),
            ranges_known=False,
            parameters=parameter_entries((each.definition for each in CONSOLE_HOUSEKEEPING), None),
            commands=(),
            zones=(),
            footprint=None,
        )

    async def run(self) -> None:
        """Publish the figures periodically."""
        while True:
            self._publish()
            await asyncio.sleep(EVERY_S)

    def _publish(self) -> None:
        utc_s, self.figures = self._utc(), self._measure()
        for key, value in self.figures.items():
            quality = Quality.INVALID if value is None else Quality.GOOD
            self._sample(Sample(ASSET, key, LinkKind.CONSOLE, utc_s, utc_s, value, quality))

    def _measure(self) -> dict[str, float | None]:
        now_s, written = asyncio.get_running_loop().time(), self._archive.samples
        before_s, before = self._before
        self._before = (now_s, written)
        passed_s = now_s - before_s
        return {
            "CONSOLE_PAGES": len(self._hub.pages),
            "CONSOLE_DROPPED": self._hub.dropped,
            "CONSOLE_QUEUED": self._archive.waiting,
            "CONSOLE_LOST": self._archive.lost,
            "CONSOLE_SAMPLES": (written - before) / passed_s if passed_s > 1.0 else None,
            **usage_figures(CONSOLE, self._usage.measure()),
        }
