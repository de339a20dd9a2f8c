"""Faults of the product that storms, or a situation, must find: the test of the tests.

`python -m tests.simulated.planted` plays until each is found, and prints a table.
"""

import asyncio
import logging
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import count
from time import monotonic
from typing import Any, Final
from unittest.mock import patch
from weakref import WeakKeyDictionary

import click

from adapters.bundle import BundleAgent, BundleId
from adapters.bundle.codec.eid import Eid
from adapters.bundle.node import database
from adapters.bundle.node.store import Outbox
from adapters.mops import Message, fingerprint, refusal_of
from adapters.mrs.ground.streams import NotificationStream
from adapters.mrs.spec import ReceivedReport
from adapters.relay.orbiter.record import Outstanding
from adapters.relay.rover import bridge
from adapters.relay.rover.bridge import BundleBridge, BundledCommand, LastStop
from adapters.relay.rover.executive_link import ExecutiveRelayLink
from executive.commands import Command
from executive.core.dispatcher import Dispatcher
from executive.record import Ledger, Notifications, RelayRecord
from executive.record.notifications import Answer
from executive.values.reasons import Reason, Refusal
from executive.values.reports import TERMINAL, Identity, Report, Stage
from tests.simulated import console_faults, mocup_faults, situations
from tests.simulated.deeds import Storm, draw_console_storm, draw_mocup_storm, draw_storm
from tests.simulated.storm import QUIET_S, play

Plant = Callable[[], AbstractContextManager[object]]


@dataclass(frozen=True, slots=True)
class Planted:
    """A fault that the product does not have.

    Attributes:
        name: of it.
        why: what breaks by it.
        plant: puts it into the product, for the time of a `with`.
        situations: one of them finds it at once; none where any storm finds it soon.
        draw: draws the storms.
    """

    name: str
    why: str
    plant: Plant
    situations: tuple[Storm, ...] = ()
    draw: Callable[[int | str], Storm] = draw_storm


def _nothing(*_: object, **__: object) -> None:
    """Do nothing."""


def _report_before_commit() -> AbstractContextManager[object]:
    commit = database.GroupCommit.commit

    def notify_first(self: database.GroupCommit) -> None:
        waiting, self._waiting = self._waiting, []
        for log in waiting:
            log(None)
        commit(self)

    return patch.object(database.GroupCommit, "commit", notify_first)


def _send_before_commit() -> AbstractContextManager[object]:
    async def send(
        self: BundleAgent,
        destination: Eid,
        payload: bytes,
        *,
        lifetime_s: float | None = None,
        confirm: bool = False,
        expedited: bool = False,
    ) -> BundleId:
        identity = self._opened.node.put(destination, payload, lifetime_s, confirm, expedited)
        self._wake()
        return identity

    return patch.object(BundleAgent, "send", send)


def _delivered_when_published() -> AbstractContextManager[object]:
    async def is_confirmed(self: BundleBridge, mark: int, within_s: float) -> bool:
        return within_s == bridge.REPUBLISH_S or await original(self, mark, within_s)

    original = BundleBridge._is_confirmed
    return patch.object(BundleBridge, "_is_confirmed", is_confirmed)


def _orbiter_forgets() -> AbstractContextManager[object]:
    return patch.object(Outstanding, "add", _nothing)


def _ledger_forgets() -> AbstractContextManager[object]:
    reach = Ledger.set_stage

    def forget(self: Ledger, identity: Identity, stage: Stage) -> None:
        reach(self, identity, stage)
        if type(self) is Ledger and stage in TERMINAL and identity.command_id % 5 == 0:
            self.prune(identity, stage)

    return patch.object(Ledger, "set_stage", forget)


def _relayed_not_remembered() -> AbstractContextManager[object]:
    return patch.object(RelayRecord, "add", _nothing)


def _relay_refuses_overtaken() -> AbstractContextManager[object]:
    async def hand_over(
        self: BundleBridge, requested: Sequence[BundledCommand], *, stops: bool
    ) -> None:
        while True:
            late = (
                []
                if stops
                else [each for each in requested if self._last_stop.overtakes(each.creation)]
            )
            for each in late:
                why = ("a stop has overtaken it", Reason.STOPPED)
                await self._store(str(refusal_of(each.message, self._settings.asset, *why)))
            requested = [each for each in requested if each not in late]
            text = "".join(str(each.message) for each in requested)
            if text and self._topics.has_listener(stops=stops):
                self._topics.publish(text, stops=stops)
            if not text or await self._is_confirmed(fingerprint(text), bridge.REPUBLISH_S):
                return

    return patch.object(BundleBridge, "_hand_over", hand_over)


@contextmanager
def _missed(accepts: Callable[[int, Report], bool]) -> Iterator[None]:
    """Have clients drop a part of what they catch up with.

    Args:
        accepts: returns whether they take a report; of the highest number so far, and it.
    """
    maximum: WeakKeyDictionary[NotificationStream, int] = WeakKeyDictionary()
    missed, pass_on = NotificationStream._missed, NotificationStream._pass_on

    async def some(self: NotificationStream, consumer: Any) -> list[ReceivedReport]:
        found = await missed(self, consumer)
        return [each for each in found if accepts(maximum.get(self, 0), each.report)]

    def note(self: NotificationStream, received: ReceivedReport) -> None:
        maximum[self] = max(maximum.get(self, 0), received.report.sequence)
        pass_on(self, received)

    with (
        patch.object(NotificationStream, "_missed", some),
        patch.object(NotificationStream, "_pass_on", note),
    ):
        yield


def _from_maximum_number() -> AbstractContextManager[object]:
    return _missed(lambda maximum, each: not 0 < each.sequence < maximum)


def _refusal_published_once() -> AbstractContextManager[object]:
    return _missed(lambda _, each: each.sequence > 0)


def _caught_up_dropped() -> AbstractContextManager[object]:
    return _missed(lambda *_: False)


def _nothing_before_first_report() -> AbstractContextManager[object]:
    missed = NotificationStream._missed

    async def none_yet(self: NotificationStream, consumer: Any) -> list[ReceivedReport]:
        return await missed(self, consumer) if self._has_last else []

    return patch.object(NotificationStream, "_missed", none_yet)


def _event_for_each_hand_over() -> AbstractContextManager[object]:
    original = BundleBridge._is_confirmed

    async def is_confirmed(self: BundleBridge, mark: int, within_s: float) -> bool:
        self._unconfirmed.pop(mark, None)
        try:
            return await original(self, mark, within_s)
        finally:
            del self._unconfirmed[mark]

    return patch.object(BundleBridge, "_is_confirmed", is_confirmed)


def _answer_published_once() -> AbstractContextManager[object]:
    def confirm(self: ExecutiveRelayLink, commands: int, answers: Sequence[Message]) -> None:
        self._topics.confirm(commands)
        for each in answers:
            self._publish_message(each)

    return patch.object(ExecutiveRelayLink, "_confirm", confirm)


def _dropped_after_30_times() -> AbstractContextManager[object]:
    times: WeakKeyDictionary[BundleBridge, Counter[int]] = WeakKeyDictionary()
    original = BundleBridge._is_confirmed

    async def is_confirmed(self: BundleBridge, mark: int, within_s: float) -> bool:
        published = times.setdefault(self, Counter())
        published[mark] += within_s == bridge.REPUBLISH_S
        return await original(self, mark, within_s) or published[mark] >= 30

    return patch.object(BundleBridge, "_is_confirmed", is_confirmed)


def _last_stop_not_stored() -> AbstractContextManager[object]:
    return patch.object(LastStop, "save", _nothing)


def _overtaken_executed() -> AbstractContextManager[object]:
    examine = Dispatcher._check

    def unmarked(self: Dispatcher, command: Command, overtaken: bool) -> Refusal | None:
        object.__setattr__(command, "overtaken", False)
        return examine(self, command, overtaken)

    return patch.object(Dispatcher, "_check", unmarked)


def _published_before_commit() -> AbstractContextManager[object]:
    send_later = Notifications._send_later

    def send_first(self: Notifications, report: Report) -> None:
        for downlink in self._downlinks:
            downlink.send_reports([report])
        send_later(self, report)

    return patch.object(Notifications, "_send_later", send_first)


def _report_confirmed_at_once() -> AbstractContextManager[object]:
    notified = BundleBridge._on_notification

    def confirm(self: BundleBridge, text: str) -> None:
        self._topics.confirm(fingerprint(text))
        asyncio.get_running_loop().call_later(0.5, notified, self, text)

    return patch.object(BundleBridge, "_on_notification", confirm)


def _admitted_without_commit() -> AbstractContextManager[object]:
    def at_once(_: Notifications, answer: Answer) -> None:
        answer(True)

    return patch.object(Notifications, "answer", at_once)


def _commits_not_synced() -> AbstractContextManager[object]:
    return patch.object(database.BundleDatabase, "sync", lambda _: None)


def _later_by_a_step_back() -> AbstractContextManager[object]:
    unconfirmed = Outbox.requeue_unconfirmed

    def forgetful(self: Outbox, now_utc_ms: int) -> list[str]:
        self._checked_utc_ms = now_utc_ms
        return unconfirmed(self, now_utc_ms)

    return patch.object(Outbox, "requeue_unconfirmed", forgetful)


PLANTED: Final = (
    Planted(
        "sent before the commit",
        "the bundle agent says that payloads are on the disk, commits in the same event, may fail",
        _report_before_commit,
    ),
    Planted(
        "send returns early",
        "the bundle agent returns from `send` before its commit",
        _send_before_commit,
    ),
    Planted(
        "delivered when published",
        "rover-relay counts commands as delivered that nobody has confirmed",
        _delivered_when_published,
    ),
    Planted(
        "orbiter forgets commands", "the orbiter does not record what it sent up", _orbiter_forgets
    ),
    Planted(
        "ledger forgets commands",
        "the ledger aboard forgets every fifth command at its end, which is executed again",
        _ledger_forgets,
    ),
    Planted(
        "relayed not remembered",
        "the executive does not publish reports on relayed commands",
        _relayed_not_remembered,
    ),
    Planted(
        "A: relay refuses overtaken",
        "rover-relay refuses what a stop overtook, though it may have been executed",
        _relay_refuses_overtaken,
    ),
    Planted(
        "B: from the highest number",
        "a client does not catch up with reports that were overtaken by others",
        _from_maximum_number,
        (situations.LATE_REPORT,),
    ),
    Planted(
        "C: refusal published once",
        "a client does not catch up with refusals, which have no number",
        _refusal_published_once,
        (situations.REFUSED_UNHEARD,),
    ),
    Planted(
        "D: the same stop twice",
        "rover-relay ends when a stop that waits for its confirmation comes again",
        _event_for_each_hand_over,
    ),
    Planted(
        "E: answer published once",
        "the last report on a repeat is lost with rover-relay",
        _answer_published_once,
        situations.REPEAT_ANSWERED,
    ),
    Planted(
        "F: nothing before a report",
        "a client that has received no report does not catch up",
        _nothing_before_first_report,
        (situations.FIRST_REPORT,),
    ),
    Planted(
        "G: dropped after 30 times",
        "rover-relay drops what was published 30 times and not confirmed",
        _dropped_after_30_times,
        (situations.FORGOTTEN_ON_FULL_DISK,),
    ),
    Planted(
        "H: last stop not kept",
        "a restarted rover-relay does not know what the last stop overtook",
        _last_stop_not_stored,
        (situations.STOP_OUTLASTS_RELAY,),
    ),
    Planted(
        "overtaken is executed",
        "the executive does not heed that a stop has overtaken a command",
        _overtaken_executed,
        (situations.STOP_OUTLASTS_RELAY,),
    ),
    Planted(
        "published before commit",
        "the executive publishes reports before its commit, and uses their numbers again",
        _published_before_commit,
    ),
    Planted(
        "admitted without commit",
        "the executive admits and begins commands whose commit failed",
        _admitted_without_commit,
        (situations.FORGOTTEN_ON_FULL_DISK,),
    ),
    Planted(
        "reports confirmed at once",
        "rover-relay confirms reports before their bundle is on the disk",
        _report_confirmed_at_once,
    ),
    Planted("caught up, dropped", "a client drops what it catches up with", _caught_up_dropped),
    Planted(
        "commits are not synced",
        "the bundle agent's commits do not outlast a loss of power",
        _commits_not_synced,
        (situations.POWER_LOST,),
    ),
    Planted(
        "nxt: I: refusal not recorded",
        "rover-nxt carries a command of the relay out that it has refused",
        mocup_faults.refusal_not_recorded,
        situations.REFUSED_THEN_PLUGGED,
    ),
    Planted(
        "nxt: J: end not recorded",
        "rover-nxt sends an end that it could not record",
        mocup_faults.end_not_recorded,
        (situations.END_UNRECORDED,),
    ),
    Planted(
        "nxt: K: reply sent once",
        "rover-nxt does not send a reply again that rover-relay did not store",
        mocup_faults.reply_sent_once,
        (situations.REPLY_LOST,),
    ),
    Planted(
        "nxt: repeat passed on",
        "rover-nxt gives the brick a command that comes again",
        mocup_faults.repeat_passed_on,
        draw=draw_mocup_storm,
    ),
    Planted(
        "nxt: O: two commits",
        "rover-nxt is killed between a claim and what it replaces, and the relay gets two ends",
        mocup_faults.claimed_in_two_commits,
        (situations.CLAIMED_WHILE_WAITING,),
    ),
    Planted(
        "nxt: commits are not synced",
        "commits of rover-nxt do not outlast a loss of power, and the brick gets a command twice",
        mocup_faults.commits_not_synced,
        (situations.NXT_POWER_LOST,),
    ),
    Planted(
        "nxt: P: announced once",
        "what the executive reports to rover-nxt is lost, and the relay gets no end",
        mocup_faults.announced_once,
        (situations.ANNOUNCEMENT_LOST,),
    ),
    Planted(
        "Q: later by a step back",
        "what is to be sent again waits longer by the step of a clock that is set back",
        _later_by_a_step_back,
        (situations.CLOCK_SET_BACK, situations.CLOCK_SET_BACK_WHILE_DOWN),
    ),
    Planted(
        "console: acknowledged early",
        "rover-console acknowledges and sends commands before they are committed to its archive",
        console_faults.acknowledged_before_commit,
        draw=draw_console_storm,
    ),
    Planted(
        "console: other link's cursor",
        "rover-console catches up by one link from the cursor of the other",
        console_faults.cursor_of_other_link,
        draw=draw_console_storm,
    ),
    Planted(
        "console: failed batch dropped",
        "the archive drops what it could not write",
        console_faults.failed_batch_dropped,
        draw=draw_console_storm,
    ),
    Planted(
        "console: L: not synced",
        "the archive's commits do not outlast a loss of power, and commands are sent again",
        console_faults.commits_not_synced,
        (situations.CONSOLE_POWER_LOST,),
    ),
    Planted(
        "console: M: one number twice",
        "rover-console gives a command and a stop of one millisecond the same number",
        console_faults.numbers_of_the_clock,
        (situations.SAME_MILLISECOND,),
    ),
    Planted(
        "console: N: refused for good",
        "a stop that was answered by an error stays REJECTED, though the rover carried it out",
        console_faults.refusal_outweighs_stages,
        (situations.REFUSED_UNWRITTEN,),
    ),
)
"""Those with a letter are faults that the product had."""


@dataclass(frozen=True, slots=True)
class Search:
    """How a planted fault was looked for.

    Attributes:
        found: the promise that it broke; None if it was not found.
        kills: how many processes were killed until then.
        took_s: how long it took.
    """

    found: str | None
    kills: int
    took_s: float


def search(planted: Planted, seed: str, max_kills: int) -> Search:
    """Look for a planted fault: in its situations, or in storms one after another."""
    began_s, kills, found = monotonic(), 0, None
    storms = (planted.draw(f"{seed}.{number}" if number else seed) for number in count())
    quiet_s = situations.QUIET_S if planted.situations else QUIET_S
    with planted.plant():
        for storm in planted.situations or storms:
            played = play(storm, until_found=True, quiet_s=quiet_s)
            kills += played.kills
            if played.findings:
                found = played.findings[0].what
            if found or kills >= max_kills:
                break
    return Search(found, kills, monotonic() - began_s)


@click.command()
@click.option(
    "--seeds",
    default=4,
    show_default=True,
    help="From which each is looked for; with 0 only those that have a situation are.",
)
@click.option("--max-kills", default=400, show_default=True, help="Until each is given up.")
@click.option("--only", default="", help="Those whose names contain this.")
def main(seeds: int, max_kills: int, only: str) -> None:
    """Plant faults in the product, and print after how many kills the storms find each.

    \b
    Exit status:
      0  each was found
      1  one was not
    """
    logging.basicConfig(level=logging.CRITICAL)
    missed = 0
    for planted in PLANTED:
        if only not in planted.name:
            continue
        chosen = 1 if planted.situations else seeds
        searches = [search(planted, f"p{seed}", max_kills) for seed in range(1, chosen + 1)]
        missed += sum(each.found is None for each in searches)
        if searches:
            click.echo(_line(planted, searches))
    sys.exit(1 if missed else 0)


def _line(planted: Planted, searches: Sequence[Search]) -> str:
    times = ", ".join(
        f"{each.kills} ({each.took_s:.0f} s)" if each.found else f"not in {each.kills}"
        for each in searches
    )
    by = "; ".join(sorted({each.found for each in searches if each.found}))
    how = "situation" if planted.situations else "kills"
    return f"{planted.name:<28} {how} {times}  {by}"


if __name__ == "__main__":
    main()
