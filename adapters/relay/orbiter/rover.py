"""`RelayedRover`, one rover at the orbiter: uplinks its commands, records reports and telemetry."""

import asyncio
import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import Final, Protocol

from adapters.bundle import (
    DTN_EPOCH_UTC_MS,
    BundleAgent,
    BundleId,
    ContactOverride,
    Delivery,
    DeliveryStatus,
    StoreError,
    StoreFull,
    node_of,
)
from adapters.mal import MalError, StandardError
from adapters.mops import (
    LINK,
    UNNUMBERED,
    CommandConditions,
    Dictionary,
    Housekeeping,
    LinkHealth,
    Message,
    MopsError,
    OpenQuestions,
    decode,
    encode,
    health_of,
    housekeeping_of,
    ledger_of,
    messages_in,
    mode_of,
    parameters_of,
    questions_of,
    report_of,
)
from adapters.mrs.spec import (
    LIST_PRECONDITIONS,
    AreaError,
    duplicate_error,
    refusal_error,
    with_text,
)
from adapters.relay.orbiter.record import RoverRecord
from adapters.relay.orbiter.report_ledger import (
    LOSS_BY_STATUS,
    departure,
    with_implied_stages,
)
from adapters.relay.orbiter.settings import RelayedRoverSettings
from executive.commands import Command, Mode, Precondition, PreemptionPolicy, Stop
from executive.commands.intake import check_identity, check_lifetime
from executive.record import LedgerError, digest
from executive.values.parameters import Parameter, ParameterValue
from executive.values.plan_nodes import Question
from executive.values.reasons import Figure
from executive.values.reports import Identity, Report, ReportKind, Severity

RETRANSMIT_BATCH: Final = 20
"""Maximum number of commands that are retransmitted together."""
UNKNOWN_SOURCE: Final = "NOBODY"
"""Source of a stop whose own source cannot be encoded."""
CLOCK_AHEAD_S: Final = 60.0
"""Time ahead of the clock here after which the questions of a wrong clock aboard are replaced."""
ROUNDED_S: Final = 1.0
"""Difference of one deadline before and after a restart aboard, s."""
_LOG: Final = logging.getLogger(__name__)


class RelayedRover:
    """Forwards commands to a rover and records its reports and telemetry.

    Args:
        agent: sends the bundles.
        dictionary: MOPS formats of commands, reports and telemetry.
        utc_s: returns the time in seconds since 1970.
        lifetime_s: lifetime of commands that have none.
        grace_s: delay after its lifetime until a command counts as lost.

    Attributes:
        listener: receives reports and telemetry; None before the provider starts.
        aboard: last health report of the rover's end of the link.
        questions: open questions of the rover's plans.
        housekeeping: last health figures of the rover's executive, or of the brick's router.
    """

    def __init__(
        self,
        settings: RelayedRoverSettings,
        agent: BundleAgent,
        dictionary: Dictionary,
        record: RoverRecord,
        utc_s: Callable[[], float],
        lifetime_s: float,
        grace_s: float,
    ) -> None:
        self._lifetime_s, self._grace_s = lifetime_s, grace_s
        self.settings = settings
        self.record = record
        self.listener: RoverListener | None = None
        self.aboard: LinkHealth | None = None
        self.housekeeping = Housekeeping(0.0, {})
        self.questions = OpenQuestions(0.0)
        self._agent = agent
        self._dictionary = dictionary
        self._utc_s = utc_s
        self._name = settings.asset.upper()
        self._confirm = agent.must_confirm(settings.endpoint)
        self._sending: dict[Identity, asyncio.Future[None]] = {}
        self._publishing = asyncio.Lock()
        self._settling: set[asyncio.Task[None]] = set()

    async def close(self) -> None:
        """Close the record after the reports on lost bundles are published."""
        await asyncio.gather(*self._settling)
        self.record.close()

    async def submit(self, command: Command) -> None:
        """Accept responsibility for a command; once this returns it survives a crash here.

        Raises:
            MalError: the command was rejected, or is a duplicate.
        """
        if isinstance(command.request, Stop):
            await self._stop(command)
            return
        await self.require_new(command)
        identity = command.identity
        octets = self._spelled(command)
        done = self._sending[identity] = asyncio.get_running_loop().create_future()
        try:
            bundle, until_utc_s = await self._send(command, octets)
            self._record(command, octets, bundle, until_utc_s)
            with _as_internal():
                await self.record.durable()
        finally:
            del self._sending[identity]
            done.set_result(None)

    async def _send(self, command: Command, octets: bytes) -> tuple[BundleId, float]:
        """Send a command, stops before all else; return its bundle and the end of its lifetime."""
        left_s = self._remaining_lifetime_s(command)
        stop = isinstance(command.request, Stop)
        if left_s is None or (stop and left_s <= 0.0):
            left_s = self._lifetime_s
        try:
            bundle = await self._agent.send(
                self.settings.endpoint, octets,
                lifetime_s=left_s, confirm=self._confirm, expedited=stop,
            )  # fmt: skip
        except StoreFull as error:
            raise with_text(AreaError.BUSY, f"the relay is full: {error}") from error
        except StoreError as error:
            raise with_text(StandardError.INTERNAL, str(error)) from error
        return bundle, self._utc_s() + left_s

    def _record(
        self, command: Command, octets: bytes, bundle: BundleId, until_utc_s: float
    ) -> None:
        with _as_internal():
            self.record.outstanding.add(
                replace(command, link=LINK), octets, bundle, self._utc_s(), until_utc_s
            )

    async def _stop(self, command: Command) -> None:
        """Send a stop before any check; then check it.

        Raises:
            MalError: a check failed; the stop was sent nevertheless, unless the error denies it.
        """
        fault: MalError | None = None
        try:
            if refusal := check_identity(command):
                raise refusal_error(refusal, command.identity)
            octets = self._spelled(command)
        except MalError as error:
            fault = error
            octets = encode(
                self._dictionary.command(Stop(), Identity(UNKNOWN_SOURCE, 0), self._name)
            )
        sending = asyncio.ensure_future(self._send(command, octets))
        await asyncio.sleep(0)  # it is in the outbox; only its answer waits for the disk
        self._clear_down_override()
        with suppress(LedgerError):  # again below
            self.record.outstanding.cancel_retransmissions()
        bundle, until_utc_s = await sending
        try:
            self.record.outstanding.cancel_retransmissions()
            if fault is not None:
                raise fault
            await self.require_new(command)
            self._record(command, octets, bundle, until_utc_s)
            await self.record.durable()
        except MalError as error:
            self.notify(Severity.WARNING, f"stop {command.identity} was uplinked despite: {error}")
            raise
        except LedgerError as error:
            text = f"the stop was uplinked, but not recorded: {error}"
            raise with_text(StandardError.INTERNAL, text) from error

    def _clear_down_override(self) -> None:
        """End an override that closes the contact: no override may delay a stop."""
        node = node_of(self.settings.endpoint)
        for each in self._agent.health().neighbours:
            if each.node == node and each.override is ContactOverride.DOWN:
                self._agent.override(node, ContactOverride.BY_PLAN)

    async def require_new(self, command: Command) -> None:
        """Raise MalError unless a command is valid, new, in time; repeat a known one's report."""
        identity, now_s = command.identity, self._utc_s()
        while identity in self._sending:
            await asyncio.wait((self._sending[identity],))
        if refusal := check_identity(command):
            raise refusal_error(refusal, identity)
        known = self.record.ledger.digest_of(identity)
        if known is not None:
            with _as_internal():
                self.record.ledger.commit()
                await self.record.durable()  # the repeated report must not be lost
            self._repeat_last_report(command, known)
            raise duplicate_error(identity)
        if refusal := check_lifetime(command, now_s, now_s):
            raise refusal_error(refusal, identity)

    async def carried_out(self, command: Command, report: Report) -> None:
        """Record and report a command that was executed here; raise LedgerError on failure."""
        self.record.outstanding.add_done(command, report.utc_s, report.utc_s + self._lifetime_s)
        self._add_report(report, str(command.identity), "")
        await self.settle()

    def on_status(self, bundle: BundleId, fate: DeliveryStatus) -> None:
        """Record the delivery status of a bundle, which may belong to another rover."""
        if fate is DeliveryStatus.HANDED_ON and self._confirm:
            return  # it is retained and retransmitted until the rover confirms it
        loss = LOSS_BY_STATUS.get(fate)
        identity = self.record.outstanding.note_departure(bundle, self._utc_s(), loss)
        if loss is not None:
            settling = asyncio.create_task(self._settle())
            self._settling.add(settling)
            settling.add_done_callback(self._settling.discard)
        elif identity is not None:
            self._report(departure(identity, self._utc_s()))

    async def retransmit_unanswered(self, retry_s: float) -> None:
        """Retransmit unanswered commands; the rover repeats its last report.

        For a rover that numbers its reports, only commands without any report: none gets lost.

        Raises:
            StoreError: the store is full or cannot be written.
            LedgerError: the retransmission cannot be recorded.
        """
        now_s, begun = self._utc_s(), not self.settings.numbers_reports
        outstanding = self.record.outstanding
        for each in outstanding.unanswered(now_s - retry_s, now_s, begun, RETRANSMIT_BATCH):
            if not outstanding.is_retained(each.identity):
                continue  # a stop was sent during the loop
            left_s = each.until_utc_s - now_s
            _LOG.info("%s: %s is retransmitted", self.settings.asset, each.identity)
            await self._agent.send(
                self.settings.endpoint, each.message, lifetime_s=left_s, confirm=self._confirm
            )
            outstanding.note_retransmission(each.identity, now_s)

    def on_delivery(self, delivery: Delivery) -> None:
        """Process the messages of a bundle, before `settle`; log those of another source."""
        text = delivery.payload.decode("ascii", "replace")
        creation = delivery.identity.creation
        made_utc_s = (creation.time_ms + DTN_EPOCH_UTC_MS) / 1000
        for number, message in enumerate(messages_in(text, self._refuse)):
            try:
                self._on_message(message, f"{delivery.identity} {number}", made_utc_s)
            except MopsError as fault:
                self._refuse(str(fault))

    def notify(self, severity: Severity, text: str, figures: tuple[Figure, ...] = ()) -> None:
        """Notify of the link: kind LINK, without a number, not recorded."""
        level = logging.INFO if severity is Severity.INFORMATIONAL else logging.WARNING
        _LOG.log(level, "%s: %s", self.settings.asset, text)
        report = Report(UNNUMBERED, self._utc_s(), ReportKind.LINK, severity, text, figures=figures)
        self._report(report)

    def parameters(self) -> tuple[ParameterValue, ...]:
        """Return all parameters of the last telemetry, with its time."""
        last = self.record.last_telemetry()
        if last is None:
            now_s = self._utc_s()
            return tuple(ParameterValue(name, now_s, None) for name in Parameter)
        utc_s, octets = last
        return self._parameters(decode(octets), utc_s)

    def mode(self) -> Mode | None:
        """Return the mode of the last telemetry, or None."""
        last = self.record.last_telemetry()
        spelling = self._dictionary.spelling.telemetry
        return None if last is None else mode_of(decode(last[1]), spelling)

    def _on_message(self, message: Message, unit: str, made_utc_s: float) -> None:
        if message.source != self._name:
            raise MopsError(
                f"source: {message.source} is not {self._name}; correct asset in the relay.yaml"
                f" of the sender at {self.settings.eid}"
            )
        spelling = self._dictionary.spelling
        if message.code == spelling.link.code:
            self.aboard = health_of(message, spelling.link)
            self._expire_unreported(self.aboard)
            return
        if message.code == spelling.housekeeping.code:
            self.housekeeping = housekeeping_of(message, spelling.housekeeping)
            return
        if message.code == spelling.questions.code:
            self._note_questions(questions_of(message, spelling.questions))
            return
        if message.code == spelling.telemetry.code:
            values = self._parameters(message, made_utc_s)
            mode_of(message, spelling.telemetry)
            self.record.add_telemetry(encode(message), made_utc_s)
            if self.listener is not None:
                self.listener.on_telemetry(values)
            return
        report = report_of(message, self._dictionary, made_utc_s)
        ledger = ledger_of(message, self._dictionary)
        if self.record.ledgers.new(ledger):
            self._start_new_ledger(ledger)
        self._add_report(report, unit, ledger)

    def _note_questions(self, found: OpenQuestions) -> None:
        """Notify of each question once when it opens, and when it is no longer open."""
        if found.utc_s <= self.questions.utc_s <= self._utc_s() + CLOCK_AHEAD_S:
            return  # a repeat, or overtaken by a later message
        before = {(plan_id, each.key): each for plan_id, each in self.questions.questions}
        self.questions = found
        for plan_id, each in found.questions:
            known = before.pop((plan_id, each.key), None)
            if known is None or _is_repeated(each, known):
                self.notify(Severity.WARNING, question_text(plan_id, each))
        if not found.more:
            for plan_id, key in sorted(before):
                text = f"question {_path(key)} of plan {plan_id} is no longer open"
                self.notify(Severity.INFORMATIONAL, text)

    def _add_report(self, report: Report, unit: str, ledger: str) -> None:
        reports: Sequence[Report] = (report,)
        if not self.settings.numbers_reports:
            last = (
                None if report.identity is None else self.record.ledger.last_report(report.identity)
            )
            reports = with_implied_stages(report, last)
        for each in reports:
            part = unit if each is report else f"{unit} {each.stage}"
            new = self.record.add_report(each, part, ledger)
            if not new and self.record.contradicts(each, ledger):
                text = f"the rover used number {each.sequence} again for another report"
                self.notify(Severity.WARNING, f"{text}: {each.text}")

    def _start_new_ledger(self, ledger: str) -> None:
        """Start a new ledger of the rover; it does not know the commands of the old one."""
        first = self.record.ledgers.number(ledger, 1)
        text = f"the rover restarted with a new ledger; its reports are numbered from {first}"
        self.notify(Severity.WARNING, text)
        self.record.outstanding.end_started(self._utc_s())

    def _expire_unreported(self, aboard: LinkHealth) -> None:
        """Expire commands without a report, once the rover's downlink queue holds nothing older."""
        if aboard.undelivered:
            return
        now_s = self._utc_s()
        made_utc_s = min(aboard.utc_s, now_s)  # the rover's clock may be ahead
        self.record.outstanding.end_unreported(
            made_utc_s - aboard.oldest_age_s - self._grace_s, now_s
        )

    def _parameters(self, message: Message, utc_s: float) -> tuple[ParameterValue, ...]:
        return parameters_of(message, self._dictionary.spelling.telemetry, utc_s)

    def _refuse(self, fault: str) -> None:
        _LOG.warning("%s: %s", self.settings.asset, fault)

    async def settle(self) -> None:
        """Publish the newly recorded reports once they survive loss of power; raise LedgerError.

        No cursor follows a higher one: a client that has a cursor has all reports before it.
        """
        async with self._publishing:
            new = self.record.ledger.unpublished()
            await self.record.durable()
            self.record.ledger.mark_published(new)
            for each in new:
                self._report(each.report, each.cursor)

    async def _settle(self) -> None:
        try:
            await self.settle()
        except LedgerError as error:  # they are published with the next ones
            _LOG.error("%s", error)

    def _report(self, report: Report, cursor: int | None = None) -> None:
        if report.kind is ReportKind.LINK and report.identity is not None:
            _LOG.info("%s: %s", self.settings.asset, report.text)
        if self.listener is not None:
            self.listener.on_report(report, cursor)

    def _spelled(self, command: Command) -> bytes:
        """Return a command as octets; raise MalError if it cannot be uplinked."""
        if command.preemption is not PreemptionPolicy.APPEND:
            raise with_text(AreaError.NOT_SUPPORTED, "commands through the relay are only queued")
        if command.precondition and not self.settings.serves(*LIST_PRECONDITIONS):
            text = f"{self.settings.asset} supports no preconditions over the relay"
            raise with_text(AreaError.NOT_SUPPORTED, text)
        try:
            message = self._dictionary.command(
                command.request, command.identity, self._name, self._conditions(command)
            )
            return encode(replace(message, moe_inputs_counter=command.counter))
        except MopsError as fault:
            text = f"cannot be sent through the relay: {fault}"
            raise with_text(AreaError.REJECTED, text) from fault

    def _conditions(self, command: Command) -> CommandConditions:
        """Return the conditions of a command; stops have none."""
        if isinstance(command.request, Stop):
            return CommandConditions()
        authority = command.authority
        if authority is None:
            authority = self.record.authority(command.identity.source)
        only = (command.precondition or Precondition()).wire_values
        if command.lifetime_s is None:
            return CommandConditions(authority, None, None, None, *only)
        created_s = self._utc_s() if command.created_utc_s is None else command.created_utc_s
        return CommandConditions(authority, created_s, command.lifetime_s, None, *only)

    def _remaining_lifetime_s(self, command: Command) -> float | None:
        """Return the remaining lifetime of a command, at most its full one; None for default."""
        if command.lifetime_s is None:
            return None
        created_s = self._utc_s() if command.created_utc_s is None else command.created_utc_s
        return min(created_s + command.lifetime_s - self._utc_s(), command.lifetime_s)

    def _repeat_last_report(self, command: Command, known: bytes) -> None:
        """Repeat the last report on a command that was received again."""
        if digest(command) != known:
            self.notify(
                Severity.WARNING, f"command id {command.identity} is used by another command"
            )
            return
        identity = command.identity
        ledger = self.record.ledger
        found = ledger.recorded_on(identity)
        reports = [each for each in found if each.cursor <= ledger.published]
        last = [each for each in reports if each.report.stage is not None][-1:]
        since = last[0].cursor if last else 0
        losses = (each for each in reports if each.report.kind is ReportKind.LINK)
        last += [each for each in losses if each.cursor > since]
        for each in last:
            self._report(each.report, each.cursor)
        if not last:
            self.notify(Severity.INFORMATIONAL, f"{identity}: no report received yet")


def _is_repeated(question: Question, before: Question) -> bool:
    """Return whether a question has a later deadline, as in the next cycle of its plan."""
    until_utc_s, old_utc_s = question.until_utc_s, before.until_utc_s
    if until_utc_s is None or old_utc_s is None:
        return False
    return until_utc_s > old_utc_s + ROUNDED_S


def _path(key: str) -> str:
    """Return the path of a question below its plan."""
    return key.partition("/")[2] or key


def question_text(plan_id: str, question: Question) -> str:
    """Return a question as text, with the command that answers it."""
    key, options = _path(question.key), " or ".join(question.options)
    text = f"question {key} of plan {plan_id}: {question.text} ({options})"
    if question.until_utc_s is not None:
        until = datetime.fromtimestamp(question.until_utc_s, UTC)
        default = "it fails" if question.default is None else question.default
        text += f", until {until:%Y-%m-%d %H:%M:%S} UTC, then {default}"
    return f"{text}; answer by: answerQuestion {plan_id} {key} OPTION"


@contextmanager
def _as_internal() -> Iterator[None]:
    """Raise MalError if the record cannot be read or written."""
    try:
        yield
    except LedgerError as error:
        raise with_text(StandardError.INTERNAL, str(error)) from error


class RoverListener(Protocol):
    """Receives reports and telemetry of a rover."""

    def on_report(self, report: Report, cursor: int | None) -> None:
        """Process a report, with its cursor if it was recorded."""
        ...

    def on_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Process parameter values."""
        ...
