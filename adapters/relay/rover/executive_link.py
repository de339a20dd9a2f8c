"""The executive's end of the relay link: MOPS strings on ROS topics to and from `rover-relay`."""

import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Final, Protocol, assert_never

from rclpy.node import Node
from std_msgs.msg import String, UInt64

from adapters.mops import (
    LINK,
    TO_ALL,
    Dictionary,
    Message,
    MopsError,
    event_of,
    messages_in,
    refusal_of,
    reply_of,
    telemetry_of,
)
from adapters.ros import MessageError, Topic, declare_topic, steady_timer
from executive.commands import Command, Mode
from executive.commands.intake import uses_reserved_source
from executive.commands.lifecycle import Admitted, Refused, Repeated, SubmitResult
from executive.reasons import Reason, Refusal
from executive.record import Ledger, LedgerError, RelayRecord, digest
from executive.reports import Identity, Kind, PlanUpdate, Report, Stage
from executive.state import FileEvent, Parameter, ParameterValue

LOOK_S: Final = 0.2
RETRANSMIT_LOOKS: Final = 5
"""Reports that the relay has not confirmed for so many looks are told again."""
WINDOW: Final = 50
"""Reports that are not confirmed: fewer than the topic holds."""
PAGE: Final = 100
LONGEST_SOURCE: Final = 256
Submit = Callable[[Command, Callable[[SubmitResult], None]], None]
_LOG: Final = logging.getLogger(__name__)


class Served(Protocol):
    """What subscribes, and contains what callbacks raise: `adapters.ros.node`."""

    def subscribe(self, kind: type, topic: Topic, callback: Callable[[Any], None]) -> None:
        """Subscribe to a topic."""
        ...

    def contained(self, callback: Callable[..., None]) -> Callable[..., None]:
        """Return a callback that raises nothing."""
        ...


class ExecutiveRelayLink:
    """Takes commands from a topic, and tells reports and telemetry on another.

    It implements `executive.ports.Downlink`; everything runs on the executor's thread, which is
    the core's. A report on a command that came by the relay, or an event, is told until
    `rover-relay` says that it has it, over restarts of either; the same number again is the same
    report again. Plans and files are not told: commands of either have their replies.

    Args:
        node: where the topics are made.
        command: the topic of commands.
        ledger: where reports are read that could not be told when they came.
        asset: name of the rover in messages.
    """

    def __init__(
        self, node: Node, command: Topic, ledger: Ledger, dictionary: Dictionary, asset: str
    ) -> None:
        self._node, self._command = node, command
        self._ledger, self._record = ledger, RelayRecord(ledger)
        self._dictionary, self._asset = dictionary, asset
        told = declare_topic(node, "relay_notification", "std_msgs/String, MOPS to the relay")
        self._kept_topic = declare_topic(
            node, "relay_kept", "std_msgs/UInt64, number of a report that the relay has taken over"
        )
        self._publisher = node.create_publisher(String, told.name, told.qos)
        self._submit: Submit = lambda *_: None
        self._mode: Callable[[], Mode | None] = lambda: None
        self._values: dict[Parameter, float | None] = {}
        self._written = ledger.last_sequence
        self._sent = self._record.kept
        self._unconfirmed: dict[int, None] = {}
        self._looks = self._listeners = 0

    def serve(
        self, submit: Submit, served: Served, mode: Callable[[], Mode | None] = lambda: None
    ) -> None:
        """Subscribe to commands, and hand them to an executive's inbox; report its mode."""
        self._submit, self._mode = submit, mode
        served.subscribe(String, self._command, self._on_command)
        served.subscribe(UInt64, self._kept_topic, self._on_kept)
        steady_timer(self._node, LOOK_S, served.contained(self._look))

    def report(self, report: Report) -> None:
        """Publish a report, or later where nobody listens or too many are unconfirmed."""
        again = report.sequence <= self._written
        self._written = max(self._written, report.sequence)
        if again:
            self._publish(report)
        elif self._sent == report.sequence - 1 and self._may_tell:
            self._tell(report)

    def telemetry(self, values: Sequence[ParameterValue]) -> None:
        """Publish all parameters, those that did not change included, and the mode."""
        self._values.update((value.parameter, value.value) for value in values)
        if self._listeners:
            spelling = self._dictionary.spelling.telemetry
            mode = self._mode()
            self._say(telemetry_of(self._values, spelling, self._asset, TO_ALL, mode))

    def file(self, event: FileEvent) -> None:
        """Do nothing: files go by the direct link."""

    def plan(self, update: PlanUpdate) -> None:
        """Do nothing: the commands of a plan have reports of their own."""

    @property
    def _may_tell(self) -> bool:
        return self._listeners > 0 and len(self._unconfirmed) < WINDOW

    def _tell(self, report: Report) -> None:
        self._sent = report.sequence
        if self._publish(report):
            self._unconfirmed[report.sequence] = None

    def _publish(self, report: Report) -> bool:
        message = self._message(report)
        if message is not None:
            self._say(message)
        return message is not None

    def _say(self, message: Message) -> None:
        self._publisher.publish(String(data=str(message)))

    def _message(self, report: Report) -> Message | None:
        name = self._record.ledger_name
        try:
            if report.kind is not Kind.COMMAND or report.identity is None:
                return event_of(report, self._dictionary.spelling.event, self._asset, name)
            asked = self._record.asked(report.identity)
            if asked is None:
                return None
            entry = self._dictionary.entry_of(asked.code)
            return reply_of(report, entry, self._asset, asked.counter, name)
        except (MopsError, LedgerError) as error:
            _LOG.error("report %d is not told by the relay: %s", report.sequence, error)
            return None

    def _on_kept(self, number: UInt64) -> None:
        """Take a report for confirmed; that says nothing of those before it."""
        oldest = next(iter(self._unconfirmed), None)
        if number.data not in self._unconfirmed:
            return  # it is of another ledger, or was confirmed twice
        del self._unconfirmed[number.data]
        if number.data == oldest:
            self._looks = 0
            self._record.keep(next(iter(self._unconfirmed), self._sent + 1) - 1)
        if not self._unconfirmed:
            self._catch_up()

    def _look(self) -> None:
        """Retransmit unconfirmed reports, and publish those that could not be when they came."""
        before, self._listeners = self._listeners, self._publisher.get_subscription_count()
        self._looks = self._looks + 1 if self._unconfirmed else 0
        if self._listeners > before or self._looks > RETRANSMIT_LOOKS:
            self._tell_again()
        self._catch_up()

    def _tell_again(self) -> None:
        self._looks = 0
        with suppress(LedgerError):  # the core sees that too, and says so
            for sequence in tuple(self._unconfirmed):
                for report in self._ledger.reports(sequence, count=1):
                    self._publish(report)

    def _catch_up(self) -> None:
        if self._sent == self._written or not self._may_tell or self._ledger.failing:
            return
        with suppress(LedgerError):  # the core sees that too, and says so
            for report in self._ledger.reports(self._sent + 1, count=PAGE):
                if report.sequence > self._written or not self._may_tell:
                    return
                self._tell(report)

    def _on_command(self, text: String) -> None:
        refused: list[str] = []
        for message in messages_in(text.data, refused.append):
            self._take(message, refused.append)
        if refused:
            raise MessageError(f"relay: {refused[0]}")

    def _take(self, message: Message, refuse: Callable[[str], None]) -> None:
        """Submit a command; refuse what is none for this asset."""
        if message.dest != self._asset or message.received or message.outputs:
            refuse(f"{message} is no command for {self._asset}")
            return
        try:
            command = self._read(message)
        except MopsError as fault:
            self._say(refusal_of(message, self._asset, str(fault)))
            refuse(f"{message}: {fault}")
            return
        self._submit(command, partial(self._answer, message))
        with suppress(LedgerError):  # where that cannot be read, the command is refused
            self._remember(command, message.code)

    def _read(self, message: Message) -> Command:
        request = self._dictionary.request(message)
        if message.moe_inputs_id is None:
            raise MopsError("moeinputsid: a command needs a number")
        if len(message.source) > LONGEST_SOURCE:
            raise MopsError(f"source: {len(message.source)} characters, at most {LONGEST_SOURCE}")
        identity = Identity(message.source, message.moe_inputs_id)
        return Command(identity, request, LINK, counter=message.moe_inputs_counter)

    def _remember(self, command: Command, code: int) -> None:
        """Report on the command by this link, unless its number is another command's."""
        known = self._ledger.digest_of(command.identity)
        if uses_reserved_source(command) is None and known in (None, digest(command)):
            self._record.remember(command, code)

    def _answer(self, message: Message, admission: SubmitResult) -> None:
        """Reply with a refusal where no report tells it."""
        match admission:
            case Admitted() | Repeated():
                pass
            case Refused(refusal):
                if not self._reported(message, refusal):
                    self._say(refusal_of(message, self._asset, refusal.text, refusal.reason))
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
