"""Alarms: what calls for somebody's attention, until it is over and somebody acknowledged it.

Reports of severity WARNING and above are alarms: those of a monitor's fault are active until it is
over, the others are over at once. So are parameters beyond their limits. States are those of
ISA-18.2. What stands is kept in the archive, where several consoles find the same.
"""

import asyncio
import logging
import re
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http import HTTPStatus
from typing import Final

from aiohttp import web
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    LOOK_S,
    AlarmCleared,
    AlarmRaised,
    Archive,
    Change,
    acknowledge_alarms,
    cause_of,
    change_alarms,
    read_alarms,
    standing_alarms,
)
from adapters.console.messages import AlarmStatus, Notified, Quality, Sample, TreeState
from adapters.console.web import OPERATOR, answer, body_of, page_of, refused
from executive.faults import DECLARED
from executive.values.reasons import Reason

_LOG: Final = logging.getLogger(__name__)

BEYOND_S: Final = 1.0
"""For so long a parameter is beyond a limit before that is an alarm."""
SLACK: Final = 0.01
"""Of the width of its limits, a parameter may be beyond them."""
MOST_WAITING: Final = 10_000
"""Changes that wait while the archive cannot be written."""
MOST_SEEN: Final = 1000
LONGEST_SOURCE: Final = 200

_CALM: Final = "INFORMATIONAL"
_CODES: Final = {name: declared.reason.value for name, declared in DECLARED.items()}
_LASTING: Final = frozenset(_CODES.values())
_OVER: Final = re.compile(r"(\w+) is over")

Limits = tuple[float | None, float | None]
Key = tuple[str, str]


class AlarmRequests:
    """Raises, clears and acknowledges alarms, and tells pages.

    Args:
        archive: where they are.
        publish: tells all pages how an alarm is.
        limits: between which values a parameter of an asset may be.
    """

    def __init__(
        self,
        archive: Archive,
        publish: Callable[[AlarmStatus], None],
        limits: Callable[[str, str], Limits],
    ) -> None:
        self._archive, self._publish, self._limits = archive, publish, limits
        self._waiting: deque[Change] = deque(maxlen=MOST_WAITING)
        self._something = asyncio.Event()
        self._refreshing = asyncio.Lock()
        self._told: dict[int, AlarmStatus] = {}
        self._samples: dict[Key, _LimitCheck] = {}
        self._trees: dict[str, TreeState] = {}

    def routes(self) -> list[web.RouteDef]:
        """Return where requests are answered."""
        return [
            web.get("/api/alarms", self._list),
            web.post("/api/alarms/acknowledge", self._acknowledge),
        ]

    async def run(self) -> None:
        """Write down what changes, and tell what others changed, again and again."""
        while True:
            self._something.clear()
            try:
                await self.refresh()
            except SQLAlchemyError as error:
                _LOG.error("alarms wait, as the archive cannot be used: %s", error)
                await asyncio.sleep(LOOK_S)
            try:
                async with asyncio.timeout(LOOK_S):
                    await self._something.wait()
            except TimeoutError:
                continue

    async def close(self) -> None:
        """Write down what changed at the end."""
        try:
            await self.refresh()
        except SQLAlchemyError as error:
            _LOG.error("alarms are lost, as the archive cannot be used: %s", cause_of(error))

    async def refresh(self) -> None:
        """Write down what changed, and tell pages of all that is not as they were told."""
        async with self._refreshing:
            changes = tuple(self._waiting)
            self._waiting.clear()
            try:
                if changes:
                    await self._archive.write(partial(change_alarms, changes=changes))
            except SQLAlchemyError:
                self._waiting.extendleft(reversed(changes))
                raise
            found = await self._archive.read(partial(standing_alarms, also=tuple(self._told)))
            for alarm in found:
                if self._told.get(alarm.id) != alarm:
                    self._publish(alarm)
            self._told = {alarm.id: alarm for alarm in found if alarm.standing}

    def hear_report(self, report: Notified) -> None:
        """Raise or clear what a report tells of."""
        over = _OVER.fullmatch(report.text) if report.code == Reason.FAULT_OVER.value else None
        if over is not None and over[1] in _CODES:
            self._put(AlarmCleared(report.asset, _fault(_CODES[over[1]]), report.utc))
        if report.severity == _CALM:
            return
        lasts = report.kind == "EVENT" and report.code in _LASTING
        raised = AlarmRaised(
            report.asset,
            _source_of(report),
            report.utc,
            report.severity,
            f"{report.stage}: {report.text}" if report.stage else report.text,
            report.command,
            lasts=lasts,
        )
        self._put(raised)

    def hear_tree(self, tree: TreeState) -> None:
        """Raise and clear faults of monitors by the list of those that are not over."""
        before = self._trees.get(tree.asset)
        if before is not None and tree.utc < before.utc:
            return
        self._trees[tree.asset] = tree
        known = _LASTING if before is None else frozenset(_faults_of(before))
        found = _faults_of(tree)
        for code in known - frozenset(found):
            self._put(AlarmCleared(tree.asset, _fault(code), tree.utc))
        for code, (severity, text) in found.items():
            if before is None or code not in known:
                source = _fault(code)
                self._put(_standing(tree.asset, source, tree.utc, severity, text))

    def hear_sample(self, sample: Sample) -> None:
        """Raise and clear that a parameter is beyond its limits, by whatever link it is newest."""
        limits = self._limits(sample.asset, sample.key)
        if limits == (None, None) or not isinstance(sample.value, int | float):
            return
        watched = self._samples.setdefault((sample.asset, sample.key), _LimitCheck())
        if sample.q is not Quality.GOOD or sample.utc <= watched.utc:
            return
        source = f"limit {sample.key}"
        match watched.look(sample.utc, _beyond(float(sample.value), limits, watched.alarmed)):
            case None:
                pass
            case "":
                self._put(AlarmCleared(sample.asset, source, sample.utc))
            case how:
                text = f"{sample.key} is {how}"
                self._put(_standing(sample.asset, source, sample.utc, "WARNING", text))

    def _put(self, change: Change) -> None:
        self._waiting.append(change)
        self._something.set()

    async def _list(self, request: web.Request) -> web.Response:
        await self.refresh()
        found = await self._archive.read(partial(read_alarms, page=page_of(request)))
        return answer({"alarms": found})

    async def _acknowledge(self, request: web.Request) -> web.Response:
        seen = (await body_of(request)).get("alarms")
        if not isinstance(seen, list) or len(seen) > MOST_SEEN or not all(map(_is_seen, seen)):
            text = f"alarms: at most {MOST_SEEN} [id, occurrences], as they were seen, are needed"
            raise refused(HTTPStatus.UNPROCESSABLE_ENTITY, text, field="alarms")
        acknowledge = partial(
            acknowledge_alarms, seen=seen, operator=request[OPERATOR], utc_s=self._archive.utc()
        )
        try:
            await self._archive.write(acknowledge)
            await self.refresh()
        except SQLAlchemyError as error:
            text = f"the archive cannot be used, nothing is acknowledged: {cause_of(error)}"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error
        numbers = [number for number, _ in seen]
        found = await self._archive.read(partial(standing_alarms, also=numbers))
        return answer({"alarms": [each for each in found if each.id in numbers]})


@dataclass(slots=True)
class _LimitCheck:
    """A parameter that has limits.

    Attributes:
        utc: of its newest sample.
        beyond_since: since when it is beyond them; None while it is not.
        alarmed: whether that is an alarm; None where nothing was told yet.
    """

    utc: float = 0.0
    beyond_since: float | None = None
    alarmed: bool | None = None

    def look(self, utc: float, how: str) -> str | None:
        """Return how it is beyond its limits, empty for not at all, if that is news."""
        self.utc = utc
        if not how:
            self.beyond_since = None
        elif self.beyond_since is None:
            self.beyond_since = utc
        lasts = self.beyond_since is not None and utc - self.beyond_since >= BEYOND_S
        if lasts is self.alarmed or (how and not lasts):
            return None
        self.alarmed = lasts
        return how


def _beyond(value: float, limits: Limits, alarmed: bool | None) -> str:
    """Return how a value is beyond its limits; empty where it is not.

    Somewhat beyond is not, until it is an alarm: what trembles about a limit is one alarm.
    """
    low, high = limits
    width = 0.0 if low is None or high is None else high - low
    slack = 0.0 if alarmed else SLACK * width
    if low is not None and value < low - slack:
        return f"{value:.4g}, below {low:.4g}"
    if high is not None and value > high + slack:
        return f"{value:.4g}, above {high:.4g}"
    return ""


def _standing(asset: str, source: str, utc: float, severity: str, text: str) -> AlarmRaised:
    """Return what raises an alarm that goes on, if it does not yet."""
    return AlarmRaised(asset, source, utc, severity, text, lasts=True, again=False)


def _faults_of(tree: TreeState) -> dict[int, tuple[str, str]]:
    """Return severity and text of the faults that a tree tells of, by their codes."""
    found = {}
    for line in tree.faults:
        severity, _, rest = line.partition(" ")
        name, _, text = rest.partition(": ")
        if name in _CODES:
            found[_CODES[name]] = (severity, text)
    return found


def _source_of(report: Notified) -> str:
    """Return what a report is an alarm of: the same again is the same alarm once more."""
    if report.kind == "EVENT" and report.code in _LASTING:
        return _fault(report.code)
    if report.stage is not None:
        return f"command {report.stage} {report.code or ''}".strip()
    what = report.code or re.sub(r"[0-9.]+", "#", report.text)[:LONGEST_SOURCE]
    return f"{report.kind.lower()} {what}"


def _fault(code: int | None) -> str:
    return f"fault {code}"


def _is_seen(each: object) -> bool:
    """Whether it is the id of an alarm, with how often that had occurred."""
    return isinstance(each, list) and [type(number) for number in each] == [int, int]
