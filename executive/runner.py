"""The executive: takes commands and facts, ticks the tree, commands the rover, reports.

One thread calls it; others use its inbox. A turn serves what has arrived; a tick also runs the
tree once. A leaf that raises is contained here: the tree is stopped, the rover stands, its
commands fail, and the executive goes on.
"""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Protocol

from executive.clock import Clock
from executive.commands import Command, Mode, Stop
from executive.commands.lifecycle import Admitted, Refused, SubmitResult
from executive.dispatcher import UNWRITTEN, Dispatcher
from executive.geometry import STANDING, Velocity
from executive.goals import Context, GoalQueue
from executive.mode import explain, mode_of
from executive.motion import Arbiter, Intents, Latches, make_locomotion
from executive.notifications import Notifications
from executive.plans import ActivePlans, PlanHost, Planner
from executive.ports import Downlink, MotionRover, VelocityRover, Video
from executive.reasons import Figure, Reason, Refusal
from executive.record import Ledger, LedgerError, PlanStore, Retention
from executive.reports import Kind, Severity
from executive.safety import find_hazard
from executive.settings import Settings
from executive.state import (
    CommandEnded,
    Fact,
    FileEvent,
    FileFolder,
    ForeignPublishers,
    ParameterValue,
    Status,
    Stopped,
    Telemetry,
)

_LOG = logging.getLogger(__name__)


class LeafError(Exception):
    """A leaf of the tree raised; the text is its path, the cause is what it raised."""


class Tree(PlanHost, Protocol):
    """The behaviour tree, as the runner needs it, beside which the trees of plans grow."""

    def tick(self) -> None:
        """Run every branch that is due once.

        Raises:
            LeafError: a leaf raised.
        """
        ...

    def stop(self) -> None:
        """End every running leaf."""
        ...


class Executive:
    """One asset's executive.

    Args:
        ledger: its record; commands that it holds unfinished are ended as interrupted.
        files: the folder that mission control sees.
        downlinks: who hears reports, telemetry and what happens to files.
        video: None where the asset has none.
        build_tree: makes the tree over the context that its leaves share.

    Attributes:
        inbox: the way in for other threads.
        forgetting: lets go of what the record need not hold any more.
    """

    def __init__(
        self,
        *,
        settings: Settings,
        clock: Clock,
        rover: VelocityRover | MotionRover,
        ledger: Ledger,
        files: Path,
        downlinks: Sequence[Downlink],
        build_tree: Callable[[Context], Tree],
        video: Video | None = None,
    ) -> None:
        """Take over the ledger; a rover that was moved by the process before stands."""
        self.settings = settings
        self.ledger = ledger
        self.inbox = Inbox()
        self.status = Status(clock, settings)
        locomotion, mover = make_locomotion(rover, clock, settings, self.status)
        self.context = Context(
            clock=clock,
            settings=settings,
            status=self.status,
            motion=GoalQueue(clock),
            camera=GoalQueue(clock),
            errands=GoalQueue(clock),
            intents=Intents(),
            locomotion=locomotion,
            latches=Latches(),
            agenda=ActivePlans(),
            files=FileFolder(files, self._tell_of_file),
            video=video,
        )
        self._clock = clock
        self._downlinks = downlinks
        self._arbiter = Arbiter(clock, settings, rover, mover)
        self._notifications = Notifications(clock, ledger, downlinks)
        self.telemetry = Telemetry(
            clock, self.status.values, self._send_telemetry, settings.status_interval_s
        )
        self.tree = build_tree(self.context)
        self.planner = Planner(
            clock,
            settings,
            PlanStore(ledger),
            self._notifications,
            self.context.agenda,
            self.tree,
            self.context.cancel,
        )
        self.dispatcher = Dispatcher(
            self.context,
            self._arbiter,
            ledger,
            self._notifications,
            self.telemetry,
            self.planner,
        )
        self.forgetting = Retention(ledger, settings.kept_reports)
        self.context.files.tidy()
        self.dispatcher.take_over()
        self._notifications.flush()

    @property
    def mode(self) -> Mode:
        """What the rover is about."""
        return mode_of(self.context)

    @property
    def velocity(self) -> Velocity:
        """What the rover was last commanded."""
        return self._arbiter.velocity

    @property
    def why(self) -> str:
        """One line on why the rover stands, or what moves it."""
        return explain(self.context, self.velocity)

    def observe(self, fact: Fact) -> None:
        """Take in a fact."""
        if isinstance(fact, ForeignPublishers) and fact.names != self.status.foreign:
            others = ", ".join(fact.names)
            self._notifications.event(
                Severity.WARNING,
                f"others may move the rover: {others}" if others else "nobody else moves the rover",
            )
        self.status.observe(fact)
        if isinstance(fact, CommandEnded):
            self.dispatcher.settle(fact)
        if isinstance(fact, Stopped):
            self.dispatcher.yield_to(fact)
        self._arbiter.guard()

    def event(
        self,
        severity: Severity,
        text: str,
        figures: tuple[Figure, ...] = (),
        kind: Kind = Kind.EVENT,
    ) -> None:
        """Report something that another component aboard noticed, or a link."""
        self._notifications.event(severity, text, figures=figures, kind=kind)

    def turn(self) -> None:
        """Serve what the inbox holds; a command that was admitted is ticked at once."""
        answers: list[tuple[Submission, SubmitResult]] = []
        for item in self.inbox.drain():
            match item:
                case Submission(command):
                    answers.append((item, self.dispatcher.submit(command)))
                case Question(ask):
                    ask()
        if any(isinstance(admission, Admitted) for _, admission in answers):
            stops = any(isinstance(item.command.request, Stop) for item, _ in answers)
            if stops or self._flush():
                self._run_tree()
        written = self._flush()
        for submission, admission in answers:
            submission.reply(admission if written else Refused(UNWRITTEN))

    def tick(self) -> None:
        """Serve the inbox, run plan and tree once, command the rover, send telemetry, forget."""
        self.turn()
        self._watch()
        self._run_plan()
        self._run_tree()
        self.telemetry.update()
        if self._flush():
            self._forget()

    def close(self) -> None:
        """End everything: what moves stands, goals are cancelled, the ledger is closed.

        What a ledger that fails did not take is lost, as when the process is killed.
        """
        if self.velocity != STANDING or self.context.motion.active is not None:
            self._arbiter.stop()
        self.tree.stop()
        self.dispatcher.end_goals(Refusal(Reason.INTERRUPTED, "the executive was shut down"))
        if self._flush():
            self.ledger.close()
        else:
            self.ledger.abandon()

    def _send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        for downlink in self._downlinks:
            downlink.telemetry(values)

    def _tell_of_file(self, event: FileEvent) -> None:
        for downlink in self._downlinks:
            downlink.file(event)

    def _watch(self) -> None:
        danger = find_hazard(
            self.status, self.settings, moving=self.context.motion.active is not None
        )
        if danger is not None and self.context.latches.hazard is None:
            self.dispatcher.make_safe(danger)

    def _run_plan(self) -> None:
        """Let the plan command what it wants; what it wants begins once it is written down."""
        try:
            if self.planner.tick(self.dispatcher.submit):
                self._flush()
        except LeafError as error:
            _LOG.error("leaf %s raised", error, exc_info=error.__cause__)
            self.planner.fail(_raised(error))
        except LedgerError as error:
            self._endanger(error)

    def _run_tree(self) -> None:
        self.context.intents.clear()
        try:
            self.tree.tick()
        except LeafError as error:
            self._contain(error)
        self._arbiter.commit(self.context.intents)

    def _contain(self, error: LeafError) -> None:
        _LOG.error("leaf %s raised", error, exc_info=error.__cause__)
        self.tree.stop()
        self.context.intents.clear()
        self._arbiter.stop()
        if not self.context.latches.held:
            self._arbiter.release()
        self.dispatcher.fail_active(_raised(error))

    def _flush(self) -> bool:
        known = self.ledger.failing
        try:
            self._notifications.flush()
        except LedgerError as error:
            if not known:
                _LOG.error("%s", error)
            self._endanger(error)
            return False
        return True

    def _forget(self) -> None:
        try:
            self.forgetting.tick()
        except LedgerError as error:
            self._endanger(error)

    def _endanger(self, error: LedgerError) -> None:
        danger = Refusal(Reason.LEDGER_FAILED, str(error))
        if self.context.latches.hazard is None:
            self.dispatcher.make_safe(danger)
        self.context.camera.fail_all(danger)
        self.context.errands.fail_all(danger)


def _raised(error: LeafError) -> Refusal:
    return Refusal(Reason.LEAF_RAISED, f"{error} raised {error.__cause__!r}")


@dataclass(frozen=True, slots=True)
class Submission:
    """A command, and who to tell whether it was admitted (called on the core's thread)."""

    command: Command
    reply: Callable[[SubmitResult], None]


@dataclass(frozen=True, slots=True)
class Question:
    """Something to read or do on the core's thread, which owns what it touches."""

    ask: Callable[[], None]


class Inbox:
    """A queue that wakes the core's thread.

    Args:
        wake: called from the putting thread after each put; must be thread-safe and quick.
    """

    def __init__(self, wake: Callable[[], None] = lambda: None) -> None:
        """Start empty."""
        self.wake = wake
        self._items: SimpleQueue[Submission | Question] = SimpleQueue()

    def submit(self, command: Command, reply: Callable[[SubmitResult], None]) -> None:
        """Hand over a command."""
        self._items.put(Submission(command, reply))
        self.wake()

    def ask(self, question: Callable[[], None]) -> None:
        """Have something read or done on the core's thread."""
        self._items.put(Question(question))
        self.wake()

    def drain(self) -> Iterator[Submission | Question]:
        """Yield what has come; what comes meanwhile is for the next time, so that this ends."""
        for _ in range(self._items.qsize()):
            yield self._items.get_nowait()
