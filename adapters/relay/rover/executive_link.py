"""`ExecutiveRelayLink`: commands and reports as MOPS strings, to and from `rover-relay`."""

import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import count
from math import inf
from typing import Final, Protocol, assert_never

from adapters.mops import (
    LINK,
    TO_ALL,
    Dictionary,
    Housekeeping,
    Message,
    MopsError,
    conditions_of,
    event_of,
    fingerprint,
    housekeeping_message,
    messages_in,
    questions_message,
    refusal_of,
    reply_of,
    telemetry_of,
)
from adapters.mrs.spec import reported_uncertainty
from adapters.system import OPERATING_SYSTEM, System
from executive.commands import Command, Mode, Stop
from executive.commands.intake import check_identity
from executive.commands.lifecycle import Accepted, Duplicate, Rejected, SubmitResult
from executive.record import Ledger, LedgerError, RelayRecord, digest
from executive.values.parameters import Parameter, ParameterValue
from executive.values.plan_nodes import Question
from executive.values.reasons import Reason, Refusal
from executive.values.reports import FileEvent, Identity, PlanUpdate, Report, ReportKind, Stage

POLL_S: Final = 0.2
"""Period of `poll`."""
QUESTIONS_S: Final = 30.0
"""Period of the repeats of open questions; chosen, not measured."""
QUIET_S: Final = 600.0
"""Time after the last question during which its end is repeated."""
HOUSEKEEPING_S: Final = 30.0
"""Minimum interval between housekeeping messages: the link has a low data rate."""
RETRANSMIT_POLLS: Final = 5
"""Unconfirmed reports are republished after this number of calls of `poll`."""
WINDOW: Final = 4
"""Maximum unconfirmed strings of reports; later reports wait and share a string."""
PAGE: Final = 50
"""Maximum number of reports in a string."""
MAX_ANSWERED: Final = 100
"""Maximum strings of answers that await confirmation; beyond it commands are republished."""
MAX_SOURCE_LENGTH: Final = 256
PlanQuestions = Mapping[str, tuple[Question, ...]]
"""Open questions by the ids of their plans."""
Submit = Callable[[Command, Callable[[SubmitResult], None], Callable[[], None]], None]
"""`Executive.submit`."""
_LOG: Final = logging.getLogger(__name__)


class RelayTopics(Protocol):
    """Topics between this end and `rover-relay`, as used by the link."""

    def publish(self, text: str) -> None:
        """Publish reports and telemetry, as whole messages."""
        ...

    def confirm(self, mark: int) -> None:
        """Publish the fingerprint of a confirmed string of commands."""
        ...

    def count_listeners(self) -> int:
        """Return the number of subscribers to reports."""
        ...


@dataclass(frozen=True, slots=True)
class UnconfirmedReports:
    """A string of reports that the relay has not confirmed.

    Attributes:
        first: number after the last report of the preceding string.
    """

    first: int
    text: str


class ExecutiveRelayLink:
    """Receives commands on topics, and publishes reports and telemetry on another.

    It implements `executive.values.ports.Downlink`. Except for receiving stops it runs on the
    executor's thread, which is the core's. A string of commands is confirmed once each is accepted
    or refused, and `rover-relay` has confirmed the answers that are no new reports: last reports on
    repeats, refusals without a number. A report on a command of the relay, or an event, is
    published until `rover-relay` has confirmed its string, over restarts of either; a repeated
    number is a repeated report. Plans and files are not published: commands of either have their
    replies.

    Args:
        topics: publishes the strings.
        ledger: holds reports that could not be published at once.
        dictionary: MOPS formats of the messages.
        asset: name of the rover in messages.
        system: the clock, and the random name of a new ledger.
    """

    def __init__(
        self,
        topics: RelayTopics,
        ledger: Ledger,
        dictionary: Dictionary,
        asset: str,
        system: System = OPERATING_SYSTEM,
    ) -> None:
        self._topics, self._system = topics, system
        self._ledger, self._record = ledger, RelayRecord(ledger, system.random_octets)
        self._dictionary, self._asset = dictionary, asset
        self._submit: Submit = lambda *_: None
        self._mode: Callable[[], Mode | None] = lambda: None
        self._values: dict[Parameter, float | None] = {}
        self._written = ledger.last_sequence
        self._sent = self._confirmed_up_to = self._record.delivered_up_to
        self._unconfirmed: dict[int, UnconfirmedReports] = {}
        self._answered: dict[int, int] = {}
        """Fingerprint of the commands, by the fingerprint of their answers."""
        self._polls = self._listeners = 0
        self._house_s = -inf
        self._questions: PlanQuestions = {}
        self._published: PlanQuestions = {}
        self._questions_s = self._quiet_s = -inf

    def serve(
        self,
        submit: Submit,
        mode: Callable[[], Mode | None] = lambda: None,
        questions: PlanQuestions | None = None,
    ) -> None:
        """Submit commands to an executive's inbox from now on; report its mode and questions."""
        self._submit, self._mode = submit, mode
        self._questions = {} if questions is None else questions
        if questions:  # of a former process: the orbiter may have missed the end of one
            self._quiet_s = self._system.now_s() + QUIET_S

    def send_reports(self, reports: Sequence[Report]) -> None:
        """Publish reports; defer them without a subscriber, or with too many unconfirmed."""
        if any(map(reported_uncertainty, reports)):
            self._house_s = -inf
        new = [each for each in reports if each.sequence > self._written]
        if not new:  # only reports that answer a repeat: `_answer` sends them to its sender
            return
        in_turn, self._written = self._sent == self._written, new[-1].sequence
        for first in range(0, len(new), PAGE):
            if in_turn and self._may_publish:
                self._publish_reports(new[first : first + PAGE])

    def send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Publish all parameters, including unchanged ones, and the mode."""
        self._values.update((value.parameter, value.value) for value in values)
        if self._listeners:
            spelling = self._dictionary.spelling.telemetry
            mode = self._mode()
            self._publish_message(telemetry_of(self._values, spelling, self._asset, TO_ALL, mode))

    def publish_housekeeping(self, figures: Mapping[str, float | None]) -> None:
        """Publish the health figures of the executive, at most every `HOUSEKEEPING_S`."""
        now_s = self._system.now_s()
        if self._listeners and now_s >= self._house_s:
            self._house_s = now_s + HOUSEKEEPING_S
            message = Housekeeping(self._system.utc_s(), figures)
            self._publish_message(
                housekeeping_message(message, self._dictionary.spelling.housekeeping, self._asset)
            )

    def _publish_questions(self) -> None:
        """Publish all open questions at a change, and repeatedly: a message may be lost."""
        now_s = self._system.now_s()
        sent = {plan_id: some for plan_id, some in self._questions.items() if some}
        changed = sent != self._published
        if sent or changed:
            self._quiet_s = now_s + QUIET_S
        if self._listeners and (changed or self._questions_s <= now_s < self._quiet_s):
            self._published, self._questions_s = sent, now_s + QUESTIONS_S
            utc_s, entry = self._system.utc_s(), self._dictionary.spelling.questions
            self._publish_message(questions_message(sent, utc_s, entry, self._asset))

    def send_file_event(self, event: FileEvent) -> None:
        """Ignored: files use the direct link."""

    def send_plan_update(self, update: PlanUpdate) -> None:
        """Ignored: the commands of a plan have reports of their own."""

    @property
    def _may_publish(self) -> bool:
        return self._listeners > 0 and len(self._unconfirmed) < WINDOW

    def _publish_reports(self, reports: Sequence[Report]) -> None:
        """Publish reports as one string that needs confirmation."""
        first, self._sent = self._sent + 1, reports[-1].sequence
        text = "".join(str(message) for message in map(self._message, reports) if message)
        if text:
            self._unconfirmed[fingerprint(text)] = UnconfirmedReports(first, text)
            self._topics.publish(text)

    def _publish_message(self, message: Message) -> None:
        if text := _text_of(message):
            self._topics.publish(text)

    def _message(self, report: Report) -> Message | None:
        name = self._record.ledger_name
        try:
            if report.identity is None:
                return event_of(report, self._dictionary.spelling.event, self._asset, name)
            command = self._record.find(report.identity)
            if command is None:
                return None
            if report.kind is not ReportKind.COMMAND:
                return event_of(report, self._dictionary.spelling.event, self._asset, name)
            entry = self._dictionary.entry_of(command.code)
            return reply_of(report, entry, self._asset, command.counter, name)
        except (MopsError, LedgerError) as error:
            _LOG.error("report %d not published by the relay: %s", report.sequence, error)
            return None

    def on_confirmed(self, mark: int) -> None:
        """Mark a string as confirmed; earlier strings are not affected."""
        if (commands := self._answered.pop(mark, None)) is not None:
            self._topics.confirm(commands)
        if self._unconfirmed.pop(mark, None) is not None:
            self._polls = 0
            self._catch_up()

    def poll(self) -> None:
        """Republish unconfirmed reports, and publish those that were deferred."""
        before, self._listeners = self._listeners, self._topics.count_listeners()
        self._polls = self._polls + 1 if self._unconfirmed else 0
        if self._listeners > before or self._polls > RETRANSMIT_POLLS:
            self._polls = 0
            for unconfirmed in self._unconfirmed.values():
                self._topics.publish(unconfirmed.text)
        self._catch_up()
        self._publish_questions()
        first = next((each.first for each in self._unconfirmed.values()), self._sent + 1)
        if first - 1 != self._confirmed_up_to:
            self._confirmed_up_to = first - 1
            self._record.mark_delivered(self._confirmed_up_to)

    def _catch_up(self) -> None:
        """Publish the next deferred reports."""
        if self._sent == self._written or not self._may_publish or self._ledger.failing:
            return
        with suppress(LedgerError):  # the core sees that too, and reports it
            waiting = self._ledger.reports(self._sent + 1, count=PAGE)
            reports = [each for each in waiting if each.sequence <= self._written]
            if reports:
                self._publish_reports(reports)

    def command(self, text: str) -> None:
        """Submit a string of commands; raise MopsError for its first invalid message."""
        refused: list[str] = []
        messages = list(messages_in(text, refused.append))
        answers: list[Message] = []
        numbers = count(1)

        def answer(reply: Message | None) -> None:
            if reply is not None:
                answers.append(reply)
            if next(numbers) == len(messages):
                self._confirm(fingerprint(text), answers)

        for message in messages:
            self._handle_message(message, refused.append, answer)
        if refused:
            raise MopsError(refused[0])

    def _confirm(self, commands: int, answers: Sequence[Message]) -> None:
        """Confirm a string of commands, at once or when the relay has stored its answers.

        No ledger records pending answers. Until then the string is republished, over restarts of
        either process, and is answered each time.
        """
        text = "".join(map(_text_of, answers))
        if not text:
            self._topics.confirm(commands)
            return
        if len(self._answered) >= MAX_ANSWERED:
            self._answered.clear()
        self._answered[fingerprint(text)] = commands
        self._topics.publish(text)

    def _handle_message(
        self,
        message: Message,
        refuse: Callable[[str], None],
        answer: Callable[[Message | None], None],
    ) -> None:
        """Submit a command; refuse a message that is no command for this asset."""
        if message.dest != self._asset or message.received or message.executed:
            refuse(f"{message} is no command for {self._asset}")
            answer(None)
            return
        try:
            command = self._read(message)
        except MopsError as fault:
            refuse(f"{message}: {fault}")
            if not self._dictionary.is_stop(message):
                answer(refusal_of(message, self._asset, str(fault)))
                return
            identity = Identity(message.source[:MAX_SOURCE_LENGTH], message.moe_inputs_id or 0)
            command = Command(identity, Stop(), LINK)

        def reply(result: SubmitResult) -> None:
            match result:
                case Rejected(refusal) if refusal.reason is Reason.LEDGER_FAILED:
                    pass  # unconfirmed, it is received again, until its end can be recorded
                case _:
                    answer(self._answer(message, result))

        self._submit(command, reply, partial(self._remember, command, message.code))

    def _read(self, message: Message) -> Command:
        request = self._dictionary.request(message)
        if message.moe_inputs_id is None:
            raise MopsError("moeinputsid: a command needs a number")
        if len(message.source) > MAX_SOURCE_LENGTH:
            raise MopsError(
                f"source: {len(message.source)} characters, at most {MAX_SOURCE_LENGTH}"
            )
        identity = Identity(message.source, message.moe_inputs_id)
        conditions = conditions_of(message)
        return Command(
            identity,
            request,
            LINK,
            conditions.created_utc_s,
            conditions.lifetime_s,
            message.moe_inputs_counter,
            authority=conditions.authority,
            overtaken=bool(conditions.overtaken),
            precondition=None if isinstance(request, Stop) else conditions.precondition,
        )

    def _remember(self, command: Command, code: int) -> None:
        """Report on the command over this link, unless its id belongs to another command."""
        with suppress(LedgerError):  # if the ledger cannot be read, the command is refused
            known = self._ledger.digest_of(command.identity)
            if check_identity(command) is None and (known is None or known == digest(command)):
                self._record.add(command, code)

    def _answer(self, message: Message, admission: SubmitResult) -> Message | None:
        """Return the answer to a command; None if reports not yet confirmed are the answer."""
        match admission:
            case Accepted():
                return None
            case Duplicate(last):
                return self._message(last)
            case Rejected(refusal):
                if self._reported(message, refusal):
                    return None
                return refusal_of(message, self._asset, refusal.text, refusal.reason)
            case _:
                assert_never(admission)

    def _reported(self, message: Message, refusal: Refusal) -> bool:
        if refusal.reason is Reason.DUPLICATE or message.moe_inputs_id is None:
            return False
        try:
            last = self._ledger.last_report(Identity(message.source, message.moe_inputs_id))
        except LedgerError:
            return False
        return last is not None and (last.stage, last.reason) == (Stage.REJECTED, refusal.reason)


def _text_of(message: Message) -> str:
    """Return a message as a string; empty if the text of its answer does not fit."""
    try:
        return str(message)
    except MopsError as error:
        _LOG.warning("not published by the relay: %s", error)
        return ""
