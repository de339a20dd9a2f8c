"""`AlarmRequests` raises alarms from received data; they stay open until cleared and acknowledged.

An alarm requires an action of an operator, and equal causes are one alarm. A fault is active until
it clears; the commands that it ends and the plan that it suspends belong to its alarm. Other
failures clear at once. Refusals, cancellations and stops are results of an operator's own action:
they are log entries. A parameter outside its limits raises an alarm, too. Open alarms are stored in
the archive, which several consoles may share.
"""

import asyncio
import logging
import re
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from http import HTTPStatus
from typing import Final

from aiohttp import web
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive import (
    POLL_S,
    AlarmCleared,
    AlarmCommand,
    AlarmRaised,
    Archive,
    Change,
    acknowledge_alarms,
    cause_of,
    change_alarms,
    open_alarms,
    read_alarms,
    shelve_alarm,
)
from adapters.console.messages import (
    AlarmStatus,
    LinkKind,
    LinkState,
    LinkStatus,
    NotificationMessage,
    Quality,
    Sample,
    TreeState,
)
from adapters.console.rovers import ParameterEntry
from adapters.console.web import (
    OPERATOR,
    body_of,
    invalid,
    is_number,
    json_response,
    refused,
    requested_page,
    text_of,
)
from executive.commands.intake import SOURCE_PREFIX
from executive.faults import DECLARED
from executive.values.quantities import quantity_text
from executive.values.reasons import Reason
from executive.values.reports import Stage

_LOG: Final = logging.getLogger(__name__)

LIMIT_DEBOUNCE_S: Final = 1.0
"""Time for which a parameter is outside its limits before an alarm, s; chosen, not measured."""
LIMIT_HYSTERESIS: Final = 0.01
"""Tolerance of the limits, share of their range, until the alarm; chosen, not measured."""
MAX_PENDING: Final = 10_000
"""Capacity of the queue of changes while the archive cannot be written."""
MAX_ACKNOWLEDGED: Final = 1000
MAX_SHELVED_S: Final = 7 * 86_400.0
MAX_COMMENT_LENGTH: Final = 400
MAX_SOURCE_LENGTH: Final = 200

_CALM: Final = "INFORMATIONAL"
_CODES: Final = {name: declared.reason.value for name, declared in DECLARED.items()}
_LASTING: Final = frozenset(_CODES.values())
_ALARMING_STAGES: Final = frozenset({Stage.FAILED.name, Stage.EXPIRED.name})
"""Stages that require an action of an operator; the others are results of such an action."""
_OWN_ACTIONS: Final = frozenset(
    reason.value
    for reason in (
        *(Reason.STOPPED, Reason.REPLACED, Reason.DUPLICATE, Reason.BAD_IDENTIFIER),
        *(Reason.PLAN_SUSPENDED, Reason.PLAN_ABORTED),
    )
)
"""Reasons of events that an operator's own action causes."""

Key = tuple[str, str]


class AlarmRequests:
    """Raises, clears, acknowledges and publishes alarms.

    Args:
        archive: stores the alarms.
        publish: sends the status of an alarm, or a log entry, to all pages.
        parameter: returns the dictionary entry of a parameter, by asset and key.
    """

    def __init__(
        self,
        archive: Archive,
        publish: Callable[[AlarmStatus | NotificationMessage], None],
        parameter: Callable[[str, str], ParameterEntry | None],
    ) -> None:
        self._archive, self._publish, self._parameter = archive, publish, parameter
        self._waiting: deque[Change] = deque(maxlen=MAX_PENDING)
        self._wake = asyncio.Event()
        self._refreshing = asyncio.Lock()
        self._published: dict[int, AlarmStatus] = {}
        self._samples: dict[Key, _LimitCheck] = {}
        self._trees: dict[str, TreeState] = {}
        self._links: dict[str, dict[LinkKind, LinkState]] = {}

    def routes(self) -> list[web.RouteDef]:
        """Return the routes."""
        return [
            web.get("/api/alarms", self._list),
            web.post("/api/alarms/acknowledge", self._acknowledge),
            web.post("/api/alarms/shelve", self._shelve),
        ]

    async def run(self) -> None:
        """Store changes, and publish those of other consoles, periodically."""
        while True:
            self._wake.clear()
            try:
                await self.refresh()
            except SQLAlchemyError as error:
                _LOG.error("alarms are queued, the archive cannot be used: %s", error)
                await asyncio.sleep(POLL_S)
            try:
                async with asyncio.timeout(POLL_S):
                    await self._wake.wait()
            except TimeoutError:
                continue

    async def close(self) -> None:
        """Store the last changes."""
        try:
            await self.refresh()
        except SQLAlchemyError as error:
            _LOG.error("alarms are lost, the archive cannot be used: %s", cause_of(error))

    async def refresh(self) -> None:
        """Store the changes, and publish the alarms whose status has changed."""
        async with self._refreshing:
            changes = tuple(self._waiting)
            self._waiting.clear()
            try:
                if changes:
                    await self._archive.write(partial(change_alarms, changes=changes))
            except SQLAlchemyError:
                self._waiting.extendleft(reversed(changes))
                raise
            found = await self._archive.read(partial(open_alarms, also=tuple(self._published)))
            for alarm in found:
                before = self._published.get(alarm.id)
                if before != alarm:
                    self._publish(alarm)
                for utc, text in () if before is None else _actions(before, alarm):
                    self._publish(_log_entry(alarm, utc, text))
            self._published = {alarm.id: alarm for alarm in found if alarm.open}

    def on_report(self, report: NotificationMessage) -> None:
        """Raise or clear the alarm of a report."""
        if report.link is LinkKind.CONSOLE:  # an entry of this class
            return
        if report.code == Reason.FAULT_CLEARED.value and report.fault in _CODES:
            self._put(AlarmCleared(report.asset, _fault_key(_CODES[report.fault]), report.utc))
        change = _change_of(report)
        if change is not None:
            self._put(change)

    def on_link(self, status: LinkStatus) -> None:
        """Raise and clear the alarm of a lost link, and add log entries at loss and return."""
        links = self._links.setdefault(status.asset, {})
        before, links[status.link] = links.get(status.link), status.state
        is_up, was_up = status.state is LinkState.UP, before is LinkState.UP
        if not status.asset or is_up is was_up or (before is None and not is_up):
            return
        source, name = f"link {status.link.value}", f"{status.link.value} link"
        if is_up:
            self._put(AlarmCleared(status.asset, source, status.since))
            severity, text = _CALM, f"the {name} is up"
        else:
            is_alone = LinkState.UP not in links.values()
            severity = "ALARM" if is_alone else "WARNING"
            text = f"the {name} is lost: {status.detail}"
            self._put(_raise_persistent(status.asset, source, status.since, severity, text))
        if before is not None:
            self._publish(_entry(status.asset, "LINK", severity, status.since, text))

    def on_tree(self, tree: TreeState) -> None:
        """Raise and clear alarms of monitor faults by the tree's list of active faults."""
        before = self._trees.get(tree.asset)
        if before is not None and tree.utc < before.utc:
            return
        self._trees[tree.asset] = tree
        known = _LASTING if before is None else frozenset(_faults_of(before))
        found = _faults_of(tree)
        for code in known - frozenset(found):
            self._put(AlarmCleared(tree.asset, _fault_key(code), tree.utc))
        for code, (severity, text) in found.items():
            if before is None or code not in known:
                source = _fault_key(code)
                self._put(_raise_persistent(tree.asset, source, tree.utc, severity, text))

    def on_sample(self, sample: Sample) -> None:
        """Raise and clear the limit alarm of a parameter, by its newest sample of any link."""
        entry = self._parameter(sample.asset, sample.key)
        if entry is None or not isinstance(sample.value, int | float):
            return
        watched = self._samples.setdefault((sample.asset, sample.key), _LimitCheck())
        if sample.q is not Quality.GOOD or sample.utc <= watched.utc:
            return
        source = f"limit {sample.key}"
        match watched.update(sample.utc, _beyond(float(sample.value), entry, watched.alarmed)):
            case None:
                pass
            case "":
                self._put(AlarmCleared(sample.asset, source, sample.utc))
            case how:
                text = f"{entry.name} is {how}"
                self._put(_raise_persistent(sample.asset, source, sample.utc, "WARNING", text))

    def _put(self, change: Change) -> None:
        self._waiting.append(change)
        self._wake.set()

    async def _list(self, request: web.Request) -> web.Response:
        await self.refresh()
        found = await self._archive.read(partial(read_alarms, page=requested_page(request)))
        return json_response({"alarms": found})

    async def _acknowledge(self, request: web.Request) -> web.Response:
        seen = (await body_of(request)).get("alarms")
        if (
            not isinstance(seen, list)
            or len(seen) > MAX_ACKNOWLEDGED
            or not all(map(_is_seen, seen))
        ):
            text = f"at most {MAX_ACKNOWLEDGED} pairs [id, occurrences], as displayed, are needed"
            raise invalid("alarms", text)
        acknowledge = partial(acknowledge_alarms, seen=seen, operator=request[OPERATOR])
        return await self._change([number for number, _ in seen], acknowledge)

    async def _shelve(self, request: web.Request) -> web.Response:
        body = await body_of(request)
        number, duration_s = body.get("alarm"), body.get("duration")
        if type(number) is not int:
            raise invalid("alarm", "the id of an alarm is needed")
        if not is_number(duration_s) or not 0.0 <= duration_s <= MAX_SHELVED_S:
            text = f"a number of seconds from 0 to {MAX_SHELVED_S:g} is needed; 0 ends the shelving"
            raise invalid("duration", text, low=0.0, high=MAX_SHELVED_S)
        comment = text_of(body, "comment", MAX_COMMENT_LENGTH) if duration_s else ""
        shelving = (duration_s, request[OPERATOR], comment)
        return await self._change([number], partial(shelve_alarm, number=number, shelving=shelving))

    async def _change(self, numbers: list[int], act: Callable[..., None]) -> web.Response:
        """Apply an operator's action, and return the status of its alarms."""
        try:
            await self._archive.write(partial(act, utc_s=self._archive.utc()))
            await self.refresh()
        except SQLAlchemyError as error:
            text = f"the archive cannot be used, nothing is changed: {cause_of(error)}"
            raise refused(HTTPStatus.SERVICE_UNAVAILABLE, text) from error
        found = await self._archive.read(partial(open_alarms, also=numbers))
        return json_response({"alarms": [each for each in found if each.id in numbers]})


def _actions(before: AlarmStatus, after: AlarmStatus) -> Iterator[tuple[float, str]]:
    """Return time and text of the actions of operators on an alarm."""
    if after.acknowledged is not None and after.acknowledged != before.acknowledged:
        yield after.acknowledged, f"{after.operator} acknowledged the alarm"
    if after.shelved is not None and after.shelved != before.shelved:
        how = "ended the shelving of the alarm"
        if after.shelved_until is not None:
            minutes = (after.shelved_until - after.shelved) / 60.0
            how = f"shelved the alarm for {minutes:.0f} min ({after.comment})"
        yield after.shelved, f"{after.shelved_by} {how}"


def _log_entry(alarm: AlarmStatus, utc: float, text: str) -> NotificationMessage:
    """Return the log entry of an operator's action, with the number of the alarm.

    It is equal at all consoles, so the archive stores it once.
    """
    entry = _entry(alarm.asset, "EVENT", _CALM, utc, f"{text}: {alarm.text}")
    return replace(entry, command=alarm.command, sequence=alarm.id, cursor=alarm.id)


def _entry(asset: str, kind: str, severity: str, utc: float, text: str) -> NotificationMessage:
    """Return a log entry of the console."""
    return NotificationMessage(
        *(asset, LinkKind.CONSOLE, 0, utc, utc, kind, severity),
        *(text, None, None, None, None, None, {}),
    )


@dataclass(slots=True)
class _LimitCheck:
    """Limit check of a parameter.

    Attributes:
        utc: time of the newest sample.
        beyond_since: time at which it left its limits; None while it is within them.
        alarmed: whether the alarm is active; None before the first result.
    """

    utc: float = 0.0
    beyond_since: float | None = None
    alarmed: bool | None = None

    def update(self, utc: float, how: str) -> str | None:
        """Return how it violates its limits, empty if it does not; None without a change."""
        self.utc = utc
        if not how:
            self.beyond_since = None
        elif self.beyond_since is None:
            self.beyond_since = utc
        lasts = self.beyond_since is not None and utc - self.beyond_since >= LIMIT_DEBOUNCE_S
        if lasts is self.alarmed or (how and not lasts):
            return None
        self.alarmed = lasts
        return how


def _beyond(value: float, entry: ParameterEntry, alarmed: bool | None) -> str:
    """Return how a value violates its limits; empty if it does not.

    `LIMIT_HYSTERESIS` applies until the alarm is active, so that a value that jitters at a limit is
    one alarm.
    """
    low, high, unit = entry.low, entry.high, entry.unit
    width = 0.0 if low is None or high is None else high - low
    slack = 0.0 if alarmed else LIMIT_HYSTERESIS * width
    if low is not None and value < low - slack:
        return f"{quantity_text(value, unit)}, below {quantity_text(low, unit)}"
    if high is not None and value > high + slack:
        return f"{quantity_text(value, unit)}, above {quantity_text(high, unit)}"
    return ""


def _raise_persistent(asset: str, source: str, utc: float, severity: str, text: str) -> AlarmRaised:
    """Return the change that raises a persistent alarm, unless it is active already."""
    return AlarmRaised(asset, source, utc, severity, text, persistent=True, reoccurrence=False)


def _faults_of(tree: TreeState) -> dict[int, tuple[str, str]]:
    """Return severity and text of the active faults of a tree, by their codes."""
    return {
        _CODES[each.name]: (each.severity, each.text) for each in tree.faults if each.name in _CODES
    }


def _change_of(report: NotificationMessage) -> Change | None:
    """Return the change of alarms by a report; None if it is a log entry only."""
    if report.severity == _CALM:
        return None
    of_fault = None if report.fault is None else _CODES.get(report.fault)
    if report.stage is not None:
        if of_fault is not None and report.command is not None:
            return AlarmCommand(report.asset, _fault_key(of_fault), report.utc, report.command)
        of_plan = f"{report.asset}:{SOURCE_PREFIX}"  # the plan continues, or reports its failure
        if report.stage not in _ALARMING_STAGES or (report.command or "").startswith(of_plan):
            return None
    elif report.code in _OWN_ACTIONS:
        return None
    of_this_fault = report.kind == "EVENT" and report.code in _LASTING
    return AlarmRaised(
        report.asset,
        _fault_key(report.code) if of_this_fault else _source_of(report),
        report.utc,
        report.severity,
        f"{report.stage}: {report.text}" if report.stage else report.text,
        report.command,
        # A report without the name of its fault is of a consequence.
        persistent=of_this_fault and of_fault is not None and not _is_contact_back(report),
        reoccurrence=not of_this_fault or of_fault is not None,
    )


def _source_of(report: NotificationMessage) -> str:
    """Return the alarm source of a report: an equal report is another occurrence of the alarm."""
    if report.code is not None:
        return f"reason {report.code}"
    what = report.stage or re.sub(r"[0-9.]+", "#", report.text)[:MAX_SOURCE_LENGTH]
    return f"{report.kind.lower()} {what}"


def _is_contact_back(report: NotificationMessage) -> bool:
    """Whether the report is of an outage without a stop, which its reception shows to be over."""
    return report.code == Reason.LINK_LOST.value and report.severity == "WARNING"


def _fault_key(code: int | None) -> str:
    return f"fault {code}"


def _is_seen(each: object) -> bool:
    """Whether it is a pair of an alarm's id and its number of occurrences."""
    return isinstance(each, list) and [type(number) for number in each] == [int, int]
