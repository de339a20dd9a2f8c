"""`Executive`, the facade of the core: receives commands and facts, ticks the tree, sends reports.

One thread calls it; others use `submit` and `query`. A turn serves received commands; a tick also
runs the tree once. A leaf that raises is contained here: the tree and the rover stop, its commands
fail, and the executive continues.
"""

import logging
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from executive.commands import GROUND_LINKS, Command, Mode, Motion, PlanDefinition, Request, Stop
from executive.commands.lifecycle import Accepted, Rejected, SubmitResult
from executive.core.authority import Authority, AuthorityRecord, AuthorityRequest, AuthorityState
from executive.core.commits import Commits, open_stop_latch
from executive.core.dispatcher import Dispatcher, ledger_refusal
from executive.core.inbox import MAX_ITEMS_PER_TURN, Inbox, Query, Submission
from executive.core.link_loss import GroundMonitor
from executive.core.plan_surroundings import RoverSurroundings
from executive.core.pose_keeper import PoseKeeper
from executive.core.reactions import Reactions
from executive.core.recorder import Recorder, process_start, recorded_ports
from executive.core.recording import (
    CommandDequeued,
    CoreCall,
    CoreCalled,
    EventReported,
    FactObserved,
    GroundContact,
    ModeChanged,
    RecordingSink,
    SafeModeEntered,
)
from executive.core.ros_clients import CancelRequest
from executive.goals import Context, Goals
from executive.motion import Arbiter, SharedSolver, make_locomotion
from executive.plans import LeafError, Planner, Tree
from executive.preview import Predictor, PreviewRun
from executive.record import Ledger, LedgerError, LedgerRetention, Notifications, PlanStore
from executive.safety import FaultMonitor, unmonitored
from executive.settings import Settings
from executive.state import FileFolder, Status, Telemetry
from executive.values.clock import Clock, LatchedClock
from executive.values.facts import (
    ExternalAuthorityUse,
    ExternalCommandEnded,
    ExternalStop,
    Fact,
    ForeignPublishers,
    LaserScan,
)
from executive.values.geometry import STANDING, Velocity
from executive.values.parameters import ParameterValue
from executive.values.ports import (
    DelegatedMotionRover,
    Downlink,
    NavigationGoal,
    NavigationRover,
    VelocityRover,
    Video,
)
from executive.values.reasons import Figure, Reason, Refusal
from executive.values.reports import (
    FileEvent,
    Identity,
    PlanUpdate,
    Report,
    ReportKind,
    Severity,
    printable,
)

_LOG = logging.getLogger(__name__)

MAX_EVENT_LENGTH: Final = 4096
"""Maximum length in characters of a text reported by `Executive.report_event`; the rest is cut."""


class Executive:
    """One asset's executive.

    Within each call of `observe`, `serve_inbox`, `tick`, `report_event`, `enter_safe_mode` and
    `close`, and during construction, the clock is latched: every decision sees the same time.

    The core's thread calls `observe`, `serve_inbox` and `tick`, and owns all attributes; other
    threads call `submit` and `query`. A stop overtakes all pending commands, and stops the rover
    before `submit` returns, regardless of the core's thread.

    Commands that the ledger holds unfinished end as interrupted. The rover is commanded to zero
    velocity if a previous process may have left it moving. The state of the stop is stored in a
    file next to the ledger, `StopLatch`.

    Args:
        tape: receives a recording for a full replay; None for none.

    Attributes:
        ground: monitor of the time since the last contact with the ground.
        plan_nodes, plan_questions: see `Planner.nodes` and `ActivePlans.questions`.
        predictions: predictions, and the paths that previews request.
        safety: the active faults.
        wake: called on their thread after each `submit` or `query`; thread-safe and quick.
    """

    def __init__(
        self,
        *,
        settings: Settings,
        clock: Clock,
        rover: VelocityRover | DelegatedMotionRover,
        ledger: Ledger,
        files: Path,
        downlinks: Sequence[Downlink],
        build_tree: Callable[[Context], Tree],
        video: Video | None = None,
        solver: SharedSolver | None = None,
        inbox: Inbox | None = None,
        tape: RecordingSink | None = None,
    ) -> None:
        self.settings = settings
        self._clock = clock = LatchedClock(clock)
        self._recorder = Recorder(tape, clock)
        self.files = FileFolder(files, self._send_file_event)
        planner = rover if isinstance(rover, NavigationRover) else None
        if tape is not None:
            tape.put(process_start(settings, ledger, self.files, solver, video))
            rover, downlinks, video, solver = recorded_ports(
                tape, settings, rover, downlinks, video, solver
            )
        self._recorder.enter(CoreCalled, CoreCall.START)
        self.safety = FaultMonitor(clock, settings)
        self.status = Status(clock, settings, self.safety.history.corrected)
        self.wake: Callable[[], None] = lambda: None
        self.retention = LedgerRetention(ledger, settings.retained_reports)
        locomotion, mover = make_locomotion(rover, clock, settings, self.status, solver)
        self._context = Context(
            clock, settings, self.status, self.safety, Goals(clock), locomotion, self.files, video
        )
        self._inbox = inbox or Inbox()
        self._answers: list[tuple[Submission, SubmitResult]] = []
        self._searching: Submission | None = None
        self.ground = GroundMonitor(clock, settings.link_loss)
        self._ledger = ledger
        self._latch = open_stop_latch(ledger)
        self._downlinks = downlinks
        self._arbiter = Arbiter(clock, settings, rover, mover, self._stop_pending)
        self._notifications = Notifications(clock, ledger, downlinks)
        self._telemetry = Telemetry(
            clock, self.status.values, self._send_telemetry, settings.status_interval_s
        )
        self.tree = build_tree(self._context)
        self.predictions = Predictor(
            self._context, self._notifications, build_tree, solver, planner
        )
        self._planner = Planner(
            clock,
            settings,
            PlanStore(ledger),
            self._notifications,
            self._context.plans,
            self.tree,
            self._context.goals.cancel,
            self.predictions.predict_plan,
            RoverSurroundings(self._context, self.ground, self._notifications),
        )
        self.plan_nodes, self.plan_questions = self._planner.nodes, self._context.plans.questions
        self.authority = Authority(
            clock,
            settings.authority,
            AuthorityRecord(ledger),
            lambda text: self._notifications.report_event(
                Severity.INFORMATIONAL, text, foreign=True
            ),
        )
        self._pose = PoseKeeper(
            clock, settings, self.safety, self.status, ledger, self._notifications
        )
        self._reactions = Reactions(
            self._context,
            self._arbiter,
            ledger,
            self._latch,
            self._notifications,
            self._planner,
            self._pose,
            self.ground,
        )
        self._dispatcher = Dispatcher(
            self._context,
            ledger,
            self._notifications,
            self._telemetry,
            self._planner,
            self.authority,
            self.predictions,
            self._pose,
            self._reactions,
        )
        self._commits = Commits(
            self._context,
            ledger,
            self._latch,
            self._notifications,
            self._pose,
            self._reactions,
            self._recorder,
        )
        for each in unmonitored(settings):
            _LOG.info("%s (%s)", each, ", ".join(each.faults))
        self.files.remove_partial_files()
        self._dispatcher.restore_settings()
        self._reactions.recover()
        self._commits.flush()
        if (error := ledger.state.error) is not None:
            raise error
        self._clock.end()

    def submit(
        self,
        command: Command,
        reply: Callable[[SubmitResult], None],
        prepare: Callable[[], None] = lambda: None,
    ) -> None:
        """Submit a command, from any thread.

        Args:
            command: the command.
            reply: called on the executive's thread with the result.
            prepare: called on that thread before the command is examined, but after a stop acts;
                its writes to the ledger are committed with the command.
        """
        if command.link in GROUND_LINKS:
            self.ground.record_contact()
        self._inbox.put(command, reply, prepare)
        if isinstance(command.request, Stop):
            try:
                self._arbiter.emergency_stop()
            except Exception:
                _LOG.exception("the emergency stop raised: the core's thread stops the rover")
        self.wake()

    def query(self, question: Query) -> None:
        """Run a query on the executive's thread, from any other thread."""
        self._inbox.put_query(question)
        self.wake()

    def emergency_stop(self) -> None:
        """Stop the rover, from any thread; motion continues once the core's thread does.

        For a watchdog. All other callers submit a `Stop`.
        """
        self._arbiter.emergency_stop()

    @property
    def mode(self) -> Mode:
        """The mode of the asset."""
        return self._context.mode

    @property
    def held_until_resume(self) -> bool:
        """Whether a stop, or a fault of the executive, holds the rover until it is resumed.

        The robot's own emergency stop is released at the robot first, and does not count here.
        """
        return self._context.latches.stopped_by is not None or self.safety.held_until_resume

    @property
    def velocity(self) -> Velocity:
        """The last commanded velocity."""
        return self._arbiter.velocity

    @property
    def why(self) -> str:
        """One line on the rover's present motion and its reason."""
        return self._context.why

    @property
    def active_command(self) -> Identity | None:
        """The active command: a stop before motion, motion before the camera."""
        if self._context.latches.stopping:
            return self._context.latches.stopping[-1].command.identity
        goal = self._context.goals.active
        return None if goal is None else goal.command.identity

    @property
    def queued_goals(self) -> int:
        """Number of accepted commands that wait."""
        return self._context.goals.waiting

    @property
    def goal_count(self) -> int:
        """Number of accepted commands, waiting or active."""
        return len(self._context.goals)

    @property
    def waiting(self) -> int:
        """Number of pending commands and queries."""
        return self._inbox.waiting

    @property
    def active_plan(self) -> str | None:
        """The plan that controls the rover, if any."""
        return self._context.plans.executing

    @property
    def moving(self) -> bool:
        """Whether a motion goal is active."""
        return self._context.goals.motion.active is not None

    @property
    def video(self) -> Video | None:
        """Forwarder of the camera's video stream, if the asset has one."""
        return self._context.video

    @property
    def status_interval_s(self) -> float:
        """Interval of telemetry in seconds; 0 sends changed parameters only."""
        return self._telemetry.interval_s

    @property
    def last_sequence(self) -> int:
        """The sequence number of the last committed report."""
        return self._notifications.last_sequence

    @property
    def ledger_writable(self) -> bool:
        """Whether the last commit of the ledger succeeded."""
        return not self._ledger.failing

    @property
    def commit_backlog(self) -> tuple[int, float]:
        """Number of commits that wait for the disk, and waiting time of the first report, s."""
        return self._ledger.unwritten_batches, self._notifications.commit_wait_s

    def parameters(self) -> tuple[ParameterValue, ...]:
        """Return the present values of all twelve parameters."""
        return self.status.values()

    def plans(self) -> Sequence[PlanUpdate]:
        """Return the progress of each plan, in the order of submission."""
        return self._planner.updates()

    def plan_definition(self, plan_id: str) -> PlanDefinition | None:
        """Return a plan as submitted; None if there is no such plan."""
        return self._planner.definition(plan_id)

    def reports(
        self, since: int = 1, command_id: int | None = None, count: int = 1000
    ) -> Sequence[Report]:
        """Return reports from a sequence number on, oldest first; see `Ledger.reports`."""
        return self._ledger.reports(since, command_id, count)

    def request_of(self, identity: Identity) -> Request | None:
        """Return the request of a command, if the ledger still stores it; see `Ledger.request`."""
        return self._ledger.request(identity)

    def preview(self, request: Motion | PlanDefinition) -> PreviewRun | Refusal:
        """Return a run that computes the preview of a motion or a plan, or the refusal.

        The preview begins where the waiting and active motions end. Mode, queue and authority do
        not matter, since nothing is commanded.
        """
        return self.predictions.preview(request)

    def observe(self, fact: Fact) -> None:
        """Process a fact."""
        with self._clock:
            self._recorder.enter(FactObserved, fact)
            if isinstance(fact, ForeignPublishers) and fact.names != self.status.foreign_publishers:
                text = f"other velocity publishers: {', '.join(fact.names) or 'none'}"
                self._notifications.report_event(Severity.WARNING, text, publishers=fact.names)
            jump = self.safety.history.jump
            self.safety.observe(fact)
            self.status.observe(fact)
            if self.safety.history.jump is not jump:
                self.status.clear_local_map()
            if isinstance(fact, ExternalCommandEnded):
                self._reactions.on_external_result(fact)
            if isinstance(fact, ExternalStop):
                self._reactions.on_external_stop(fact)
            if isinstance(fact, ExternalAuthorityUse):
                self.ground.record_contact()
                self.authority.renew_lease(fact.epoch)
            if isinstance(fact, LaserScan):
                self._reactions.run_monitors()  # immediately, without waiting for the tick
            self._arbiter.stop_if_stale()

    def request_authority(
        self, request: AuthorityRequest, reply: Callable[[AuthorityState | Refusal], None]
    ) -> None:
        """Request, take, hand over or release the authority; on the executive's thread.

        Args:
            request: the request.
            reply: called with the result on that thread, once a change of holder is committed.
        """
        self._recorder.put(request)
        result, grant = self.authority.perform(request), self.authority.grant
        on_written = partial(self.authority.on_written, grant)
        self._notifications.answer(lambda written: reply(on_written(written) or result))

    def cancel(self, request: CancelRequest) -> None:
        """Cancel one command of a ROS client; on the executive's thread, in a query."""
        self._recorder.put(request)
        self._dispatcher.ros_clients.cancel(request)

    def report_event(
        self,
        severity: Severity,
        text: str,
        figures: tuple[Figure, ...] = (),
        kind: ReportKind = ReportKind.EVENT,
    ) -> None:
        """Report an event of another component or of a link."""
        within = self._clock.latched
        with self._clock:
            self._recorder.enter(EventReported, severity, text, figures, kind, within)
            figures = tuple(Figure(printable(f.name), f.value, printable(f.unit)) for f in figures)
            self._notifications.report_event(
                severity, text[:MAX_EVENT_LENGTH], figures=figures, kind=kind, foreign=True
            )

    def enter_safe_mode(self, danger: Refusal) -> None:
        """Enter SAFE until resumed; without effect if the same reason is already active."""
        within = self._clock.latched
        with self._clock:
            self._recorder.enter(SafeModeEntered, danger, within)
            self._reactions.enter_safe_mode(danger)

    def serve_inbox(self) -> None:
        """Serve pending commands and queries; if a command is accepted, the tree runs at once.

        Items that arrive during the turn, or exceed `MAX_ITEMS_PER_TURN`, wait for the next one;
        stops are served before each other item. Then predictions advance by a slice; if more work
        remains, the executive wakes itself.
        """
        with self._clock:
            self._recorder.enter(CoreCalled, CoreCall.SERVE)
            self._serve()
            self._predict()
            self._record_state()

    def _serve(self) -> None:
        """Serve pending commands and queries."""
        released = self._commits.settle()
        self._serve_stops()
        self._reactions.check_ground_link(self._dispatcher.submit)
        if self.ground.in_contact:
            self._recorder.put(GroundContact())
        for _ in range(self._inbox.pending_items + (self._searching is not None)):
            if len(self._answers) >= MAX_ITEMS_PER_TURN or not self._serve_item():
                break
            self._serve_stops()
        answers, self._answers = self._answers, []
        if any(isinstance(admission, Accepted) for _, admission in answers):
            stops = any(isinstance(item.command.request, Stop) for item, _ in answers)
            released = stops or self._commits.flush() or released
        if released:
            self._run_tree()
        for item, admission in answers:
            self._notifications.answer(partial(self._reply, item, admission))
        self._commits.flush()
        if not self._inbox.empty:
            self.wake()

    def _serve_item(self) -> bool:
        """Serve the next command or query; return False if it waits for a search."""
        item, overtaken = self._searching or self._inbox.take(), False
        if not isinstance(item, Submission):
            item()
            return True
        if item is not self._searching:
            overtaken = self._inbox.superseded_by_stop(item)
            self._recorder.put(CommandDequeued(item.command, overtaken))
        self._searching = item if self._dispatcher.awaits_detour(item.command) else None
        if self._searching is None:
            item.prepare()
            self._answers.append((item, self._dispatcher.submit(item.command, overtaken)))
        return self._searching is None

    def _reply(self, submission: Submission, admission: SubmitResult, written: bool) -> None:
        answer = admission if written else Rejected(ledger_refusal(submission.command))
        self._recorder.on_answer(submission.command.identity, answer)
        submission.reply(answer)

    def tick(self) -> None:
        """Serve a turn, run plan and tree once, command the rover, send telemetry, prune."""
        with self._clock:
            self._recorder.enter(CoreCalled, CoreCall.TICK)
            self._serve()
            self._reactions.check_lateness()
            self._reactions.run_monitors()
            self._reactions.report_other_drivers()
            self._run_plan()
            self._reactions.suspend_plan_if_held()
            self._run_tree()
            self._telemetry.update()
            self._dispatcher.tick()
            if self._commits.flush():
                try:
                    self.retention.tick()
                except LedgerError as error:
                    self._reactions.on_ledger_failure(error)
            self._predict()
            self._record_state()

    def close(self) -> None:
        """Close the executive: a moving rover stops, goals are cancelled, the ledger is closed.

        Data that a failing ledger did not commit are lost, as when the process is killed.
        """
        with self._clock:
            self._recorder.enter(CoreCalled, CoreCall.CLOSE)
            if self.velocity != STANDING or self.moving:
                self._arbiter.stop()
            self.tree.stop()
            self._reactions.shut_down()
            if not self._context.latches.held:
                self._arbiter.release()
            self._commits.flush()
            self._ledger.writer.close()  # its last attempt also stores the stop latch
            self._commits.settle()
            if (change := self._latch.take_change()) is not None:
                change.store()
            self._ledger.abandon()
            self._latch.close()

    def simulate_crash(self) -> None:
        """End as `kill -9` would: nothing further is written."""
        self._ledger.abandon()
        self._latch.close()

    def _serve_stops(self) -> None:
        """Stop the rover for pending stops, and process their records and replies."""
        for _ in range(self._inbox.pending_stops):
            stop = self._inbox.take_stop()
            self._recorder.put(CommandDequeued(stop.command, overtaken=False))
            self._reactions.stop(stop.command.identity)
            stop.prepare()
            self._answers.append((stop, self._dispatcher.submit(stop.command)))

    def _stop_pending(self) -> bool:
        waits = self._inbox.stop_pending
        self._recorder.on_stop_check(waits)
        return waits

    def _record_state(self) -> None:
        if self._recorder.tape is not None:
            fault, stop = self._context.holding_fault, self._context.holding_stop
            mode = ModeChanged(self.mode, self.active_command, self.why, fault, stop)
            self._recorder.on_state(self.tree.nodes(), mode)

    def _send_telemetry(self, values: Sequence[ParameterValue]) -> None:
        for downlink in self._downlinks:
            downlink.send_telemetry(values)

    def _send_file_event(self, event: FileEvent) -> None:
        for downlink in self._downlinks:
            downlink.send_file_event(event)

    def _run_plan(self) -> None:
        """Tick the executing plan, which submits its commands; they start once committed."""
        try:
            if self._planner.tick(self._dispatcher.submit):
                self._commits.flush()
        except LeafError as error:
            _LOG.error("leaf %s raised", error, exc_info=error.__cause__)
            self._planner.fail(_raised(error))
        except LedgerError as error:
            self._reactions.on_ledger_failure(error)

    def _run_tree(self) -> None:
        self._context.intents.clear()
        try:
            self.tree.tick()
        except LeafError as error:
            _LOG.error("leaf %s raised", error, exc_info=error.__cause__)
            self.tree.stop()
            self._context.intents.clear()
            self._arbiter.stop()
            if not self._context.latches.held:
                self._arbiter.release()
            self._reactions.fail_active(_raised(error))
        if not self.moving and isinstance(self._context.intents.motion, Velocity | NavigationGoal):
            self._context.intents.motion = STANDING  # the goal of this intent has ended
        self._arbiter.commit(self._context.intents)
        self._reactions.note_command()

    def _predict(self) -> None:
        """Advance searches of detours by a slice, or else predictions."""
        searching = self._context.detours.advance()
        if not searching and self.predictions.advance():
            self._commits.flush()
        if searching or self._searching is not None or self.predictions.pending:
            self.wake()


def _raised(error: LeafError) -> Refusal:
    return Refusal(Reason.LEAF_RAISED, f"{error} raised {error.__cause__!r}")
