"""A brick and an executive, as the two links of MOCUP see them."""

from collections import deque
from dataclasses import replace

from adapters.mocup import ClaimAnnouncer, MocupFact, MocupRover
from adapters.mops import Message, RelayAuthority, load_dictionary, messages_in
from executive.commands.catalogue import MoveForward, MoveTo, Request, Stop, Waypoint
from executive.values.clock import ManualClock
from executive.values.facts import ExternalCommandEnded, ExternalStop, MotionEnded
from executive.values.ports import DelegatedMotion, DriveBy, TurnBy
from executive.values.reports import Identity, Report, ReportKind, Severity, Stage

DICTIONARY = load_dictionary()
STOP = DICTIONARY.spelling.commands["stop"]
SETTINGS = {DICTIONARY.spelling.commands[n] for n in ("setTravelSpeed", "setRotateSpeed")}
STOPS = range(100, 103)
"""Numbers of the relay's stops."""


def request(number: int) -> Request:
    if number in STOPS:
        return Stop()
    return MoveTo(Waypoint(1.0 * number, 2.0)) if number % 2 else MoveForward(0.5 * number)


def motions(number: int) -> list[TurnBy | DriveBy]:
    whole = DriveBy(0.5 * number, 0.2)
    return [TurnBy(0.1 * number, 1.0), whole] if number % 2 else [whole]


class Brick:
    """Does one thing at a time; a stop comes between."""

    def __init__(self) -> None:
        self.task: Message | None = None
        self.begun: list[Message] = []
        self.output: deque[Message] = deque()

    def receive(self, message: Message) -> None:
        if message.code == STOP:
            self.end("CANCELLED")
            self._send(message, "EXECUTED")
        elif self.task is not None:
            self._send(message, "REJECTED")
        else:
            self.task = message
            self.begun.append(message)
            self._send(message, "STARTED")

    def end(self, stage: str = "EXECUTED") -> None:
        task, self.task = self.task, None
        if task is not None:
            self._send(task, stage)

    def _send(self, to: Message, stage: str) -> None:
        received, executed = stage != "REJECTED", stage == "EXECUTED"
        text = replace(to, source=to.dest, dest=to.source, inputs=(), outputs=(stage, "", ""))
        self.output.append(replace(text, received=received, executed=executed))


class Executive:
    """Commands one after the other, each a motion or two; a ledger that outlives the process."""

    def __init__(self, clock: ManualClock) -> None:
        self.clock = clock
        self.ledger: list[Report] = []
        self.last: dict[int, Report] = {}
        self.out: deque[Message] = deque()
        self.receives = False
        self._motion_number = 0
        self.start()

    def start(self) -> None:
        """Begin a process: what another left unfinished was interrupted."""
        self.clock.advance(0.001)
        self.out.clear()
        self.receives = False
        self.waiting: deque[int] = deque()
        self.active: int | None = None
        self.left: deque[TurnBy | DriveBy] = deque()
        self.plugin = MocupRover(
            DICTIONARY, self.clock, self.out.append, self._observe, "EXEC", "MOCUP"
        )
        self.claims = ClaimAnnouncer(
            DICTIONARY,
            lambda identity: request(identity.command_id),
            lambda: RelayAuthority(needed=False),
            lambda text: self.out.extend(messages_in(text, list[str]().append)),
            "EXEC",
            "MOCUP",
        )
        self.plugin.halt()
        for number, last in list(self.last.items()):
            if last.stage is not None and not last.stage.terminal:
                self.reach(number, Stage.FAILED, "interrupted")

    def submit(self, number: int, dies: bool = False) -> None:
        if number in self.last:
            self.claims.send_reports((self.last[number],))
            return
        self.reach(number, Stage.ACCEPTED, reported=not dies)
        self.waiting.append(number)
        if dies:
            self.start()
        else:
            self.tick()

    def stop(self) -> None:
        self.plugin.halt()
        self._cancel()

    def _cancel(self) -> None:
        for number in (*filter(None, [self.active]), *self.waiting):
            self.reach(number, Stage.CANCELLED, "stopped")
        self.waiting.clear()
        self.active = None

    def tick(self) -> None:
        self.plugin.retransmit()
        if self.active is None and self.waiting:
            self.active = self.waiting.popleft()
            self.reach(self.active, Stage.STARTED)
            self.left = deque(motions(self.active))
            self._continue()

    def receive(self, message: Message) -> None:
        self.plugin.on_reply(message)

    def again(self) -> None:
        self.claims.resend(self.ledger)

    def reach(self, number: int, stage: Stage, text: str = "", reported: bool = True) -> None:
        identity = Identity("MOE", number)
        kind, severity = ReportKind.COMMAND, Severity.INFORMATIONAL
        report = Report(len(self.ledger) + 1, 0.0, kind, severity, text, identity, stage)
        self.ledger.append(report)
        self.last[number] = report
        if reported:
            self.claims.send_reports((report,))

    def _continue(self) -> None:
        assert self.active is not None
        if not self.left:
            self._end(True, "")
            return
        self._motion_number += 1
        identity = Identity("MOE", self.active)
        self.plugin.execute_motion(
            DelegatedMotion(self._motion_number, self.left.popleft(), identity)
        )

    def _end(self, executed: bool, text: str) -> None:
        assert self.active is not None
        self.reach(self.active, Stage.EXECUTED if executed else Stage.FAILED, text)
        self.active = None

    def _observe(self, fact: MocupFact) -> None:
        if isinstance(fact, ExternalStop):
            self._cancel()
        if self.active is None:
            return
        match fact:
            case MotionEnded(number, executed, text) if number == self._motion_number:
                if executed:
                    self._continue()
                else:
                    self._end(False, text)
            case ExternalCommandEnded(identity, executed, text) if (
                identity.command_id == self.active
            ):
                self._end(executed, text)
