"""`PosePredictor`: the twin of an asset, fed with the data of its links, for the pages' map."""

import asyncio
import logging
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from math import inf, isfinite
from typing import Final

from adapters.console.messages import LinkKind, PosePrediction
from adapters.console.rovers.rover_link import CLOCK_OFFSET, RoverLink
from adapters.mrs.spec import AssetMode, AssetStatus, ReceivedValue
from adapters.twin import ReportedPose, Twin
from executive.commands import Command
from executive.settings import Settings
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reports import Report

_LOG: Final = logging.getLogger(__name__)

PREDICTION_S: Final = 1.0
"""Interval of predictions, s."""
SLICE_TICKS: Final = 50
"""Ticks of the twin between two turns of the event loop: some 10 ms."""
MAX_DELAY_CHANGE: Final = 0.2
"""Minimum change of the delay, as a ratio, for the twin to use the new one; chosen."""
MAX_CLOCK_STEP_S: Final = 1.0
"""Maximum change of the onboard clock's lead, s; beyond it the twin starts again; chosen."""
LIGHT_TIME: Final = "DTN_ROUND_TRIP"
_POSITION: Final = (Parameter.POS_X.value, Parameter.POS_Y.value, Parameter.HEAD.value)
_HELD: Final = (AssetMode.STOPPED, AssetMode.SAFE)


class PosePredictor:
    """Predicts the pose of one asset over the link that commands take, if that has a delay.

    An error of the twin ends the prediction. It never reaches links, commands or stops.

    Args:
        settings: installed settings of the asset; without them nothing is predicted.
    """

    def __init__(self, settings: Settings | None) -> None:
        self._settings = settings
        self._twin: Twin | None = None
        self._values: dict[str, ReceivedValue] = {}
        self._stopped = False
        self._lead_s = 0.0

    def on_sent(self, command: Command, utc_s: float) -> None:
        """Add a command that is sent."""
        with self._contained():
            if self._twin is not None:
                self._twin.on_sent(command, utc_s)

    def on_report(self, report: Report) -> None:
        """Receive a report."""
        with self._contained():
            if self._twin is not None and report.identity is not None and report.stage is not None:
                self._twin.on_stage(report.identity, report.stage, report.utc_s - self._lead_s)

    def on_status(self, status: AssetStatus) -> None:
        """Receive the mode."""
        self._stopped = status.mode in _HELD

    def on_value(self, value: ReceivedValue) -> None:
        """Receive a value; the last one of a pose completes it."""
        self._values[value.name] = value
        x, y, heading = (self._number(each, value.utc_s) for each in _POSITION)
        if self._twin is None or value.name not in _POSITION:
            return
        if x is not None and y is not None and heading is not None:
            reported = ReportedPose(
                value.utc_s - self._lead_s,
                Pose(x, y, heading_rad=heading),
                self._number(Parameter.TRAVEL_SPEED.value),
                self._number(Parameter.ROTATE_SPEED.value),
                self._stopped,
            )
            with self._contained():
                self._twin.on_pose(reported)

    async def predict(self, link: RoverLink | None, utc_s: float) -> PosePrediction | None:
        """Return where a command that is sent now finds the asset; None if the link has no delay.

        Args:
            link: the link that commands take.
            utc_s: present time.
        """
        try:
            return await self._predict(link, utc_s)
        except Exception:
            self._fail()
            return None

    async def _predict(self, link: RoverLink | None, utc_s: float) -> PosePrediction | None:
        if link is None:
            return None  # commands sent before may still arrive
        relayed = link.kind is LinkKind.RELAY
        lead_s = link.figures.get(CLOCK_OFFSET, self._lead_s if relayed else inf)
        if abs(lead_s - self._lead_s) > MAX_CLOCK_STEP_S:
            self.close()
        if lead_s == inf:
            return None  # without the lead of the onboard clock its stamps mean nothing here
        self._lead_s = lead_s
        if self._settings is None or not (relayed or link.delay.is_noticeable):
            self.close()
            return None
        one_way_s = link.delay.one_way_s
        one_way_s += (self._number(LIGHT_TIME) or 0.0) / 2 if relayed else 0.0
        twin = self._twin = self._twin or Twin(self._settings, one_way_s)
        if abs(one_way_s - twin.one_way_s) > MAX_DELAY_CHANGE * twin.one_way_s:
            twin.one_way_s = one_way_s
        while not twin.advance(utc_s, SLICE_TICKS):
            await asyncio.sleep(0)
        found = twin.predict(utc_s)
        if found is None:
            return None
        x_m, y_m, heading_rad = found.pose.x_m, found.pose.y_m, found.pose.heading_rad
        return PosePrediction(
            link.asset,
            link.kind,
            utc_s,
            found.as_of_utc_s,
            found.arrival_utc_s,
            x_m,
            y_m,
            heading_rad,
            found.deviation_m,
            tuple((each.x_m, each.y_m) for each in found.path),
        )

    def close(self) -> None:
        """Delete the twin."""
        twin, self._twin = self._twin, None
        if twin is not None:
            twin.close()

    @contextmanager
    def _contained(self) -> Iterator[None]:
        """End the prediction at any error within."""
        try:
            yield
        except Exception:
            self._fail()

    def _fail(self) -> None:
        _LOG.exception("poses are not predicted from now on")
        self._settings = None
        with suppress(Exception):
            self.close()

    def _number(self, name: str, utc_s: float | None = None) -> float | None:
        """Return the last value of a parameter if it is a number, and of this stamp if given."""
        known = self._values.get(name)
        if known is None or utc_s not in {None, known.utc_s}:
            return None
        return known.value if isinstance(known.value, float) and isfinite(known.value) else None
