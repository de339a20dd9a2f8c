"""`run_in_lock_step` runs a scenario in one thread on simulated time; repetitions are identical.

The ground receives everything that the rover sends, except during an outage.
"""

import time
from collections.abc import Callable, Iterator
from math import ceil, cos, inf, sin
from pathlib import Path
from typing import assert_never
from zlib import crc32

from executive.commands import Command, SetPositionCompensation
from executive.commands.lifecycle import Accepted, Duplicate, Rejected
from executive.core.recording import (
    CargoChanged,
    LinkDarkChanged,
    RecordingSink,
    TimelinePlayed,
    TimelineStarted,
)
from executive.goals import Context
from executive.plans import Tree
from executive.settings import SettingsError
from executive.values.clock import START_UTC_S
from executive.values.geometry import wrap_rad
from executive.values.reasons import Reason, Refusal
from sim.rover.camera import PictureSettings
from sim.rover.faults import LinkLost, SimulatedFault, fault_declaration
from sim.rover.jackal import SimulatedJackal
from sim.rover.lockstep import STEP_S, DownlinkRecorder, LockStep
from sim.rover.simulation import fault_changed
from sim.scenario import model
from sim.scenario.model import Entry, RunMode, Scenario
from sim.scenario.reading import write_timeline
from sim.scenario.record import (
    ALMOST_S,
    AdmittedRequest,
    Answer,
    FaultChange,
    Fetched,
    FetchFailed,
    ModeSample,
    QueryAnswer,
    Record,
    SentCommand,
    TruePose,
)
from sim.scenario.timeline import CommandFactory, Timeline
from sim.scenario.truth import load_requests
from trees import RoverTree


class DownlinkCollector:
    """Copies the downlink of a rover into the record of a run.

    Attributes:
        lost: whether the link is lost, until the fault is cleared.
        dark: whether the link is down now, by a loss or an outage.
    """

    def __init__(self, recorder: DownlinkRecorder, record: Record) -> None:
        self._recorder = recorder
        self._record = record
        self._batches = 0
        self._until_s = -inf
        self.lost = False
        self.dark = False

    def set_lost(self, lost: bool) -> None:
        """Set or clear the loss of the link; an outage still applies."""
        self.lost = lost
        self.dark = self.dark or lost

    def start_outage(self, until_s: float) -> None:
        """Block the downlink until then; reports are received later, telemetry is lost."""
        self._until_s = max(self._until_s, until_s)
        self.dark = True

    def ends_s(self, now_s: float) -> Iterator[float]:
        """Yield the end of an outage, if there is one."""
        if now_s < self._until_s:
            yield self._until_s

    def listen(self, now_s: float) -> None:
        """Copy the downlink since the last call, unless the link is down."""
        self.dark = self.lost or now_s < self._until_s - ALMOST_S
        downlink, record = self._recorder, self._record
        batches = downlink.telemetry_batches[self._batches :]
        self._batches += len(batches)
        if self.dark:
            return
        for batch in batches:
            record.values += record.received_values(batch)
        record.reports += downlink.reports[len(record.reports) :]
        record.file_events += downlink.file_events[len(record.file_events) :]
        record.plans += downlink.plans[len(record.plans) :]


def run_in_lock_step(
    scenario: Scenario,
    folder: Path,
    tape: RecordingSink | None = None,
    rover: SimulatedJackal | None = None,
    start_utc_s: float = START_UTC_S,
    build_tree: Callable[[Context], Tree] = RoverTree,
    run: "Callable[[Scenario, LockStep, Record], LockstepRun] | None" = None,
    skips: bool = False,
) -> Record:
    """Run a scenario and return its record.

    Args:
        scenario: scenario to run.
        folder: empty folder for ledger and files.
        tape: records the executive; None for no recording.
        rover: a Jackal in the scenario's world with further parts; None for the scenario's rover.
        start_utc_s: UTC of the start.
        build_tree: builds the tree of each executive.
        run: makes a run that ends by itself.
        skips: whether the time of standing passes at once.

    Raises:
        SettingsError: MuJoCo refuses the world.
    """
    camera = scenario.settings.camera
    picture = PictureSettings(camera.width_px, camera.height_px)
    try:
        lock = LockStep(
            scenario.settings,
            scenario.world,
            folder,
            scenario.seed,
            picture=picture,
            odometry=scenario.odometry,
            tape=tape,
            rover=rover,
            start_utc_s=start_utc_s,
            skips=skips,
            build_tree=build_tree,
        )
    except ValueError as error:
        raise SettingsError(f"world: {error}") from error
    record = Record(lock.clock.utc_s(), folder / "files")
    began_s = time.perf_counter()
    (run or LockstepRun)(scenario, lock, record).run()
    record.wall_s = time.perf_counter() - began_s
    record.seen = lock.executive.status.obstacles.scanned
    lock.executive.simulate_crash()
    record.simulated_s = lock.time_s
    record.energy_j = lock.rover.energy_j
    record.contacts = lock.rover.contacts
    load_requests(record, folder / "ledger.sqlite")
    return record


class LockstepRun:
    """One run of a scenario."""

    def __init__(self, scenario: Scenario, lock: LockStep, record: Record) -> None:
        self._lock = lock
        self._record = record
        self._steps = round(scenario.duration_s / STEP_S)
        self._tick_steps = round(scenario.settings.tick_s / STEP_S)
        self._timeline = Timeline(scenario, record)
        self._ground = CommandFactory(scenario, RunMode.LOCK_STEP.link)
        self._downlink = DownlinkCollector(lock.downlink_record, record)
        self._start_s = inf
        self._entries, self._dark = scenario.timeline, False
        lock.record(TimelineStarted(lock.time_s, write_timeline(scenario.timeline)))

    def run(self) -> None:
        """Step from event to event; sample the rover after each tick."""
        step = round(self._lock.time_s / STEP_S)
        while True:
            self._run_entries()
            if step >= self._steps or self.has_ended:
                return
            target = min(self._tick_steps * (step // self._tick_steps + 1), self._steps)
            event_s = min(self._timeline.next_s(), self._start_s)
            if event_s < target * STEP_S:
                target = max(step + 1, ceil(event_s / STEP_S - 1e-6))
            self._lock.run((target - step) * STEP_S)
            self._listen()
            step = target
            if step % self._tick_steps == 0:
                self.observe()
                step += round(self._lock.skip(self.next_event_s() - self._lock.time_s) / STEP_S)

    def next_event_s(self) -> float:
        """Return the time of the next event; a skip ends before it."""
        times_s = self._timeline.next_s(), self._start_s, self._steps * STEP_S
        return min(*times_s, *self._downlink.ends_s(self._lock.time_s))

    @property
    def has_ended(self) -> bool:
        """Whether the run ends before its time."""
        return False

    def _run_entries(self) -> None:
        if self._lock.time_s >= self._start_s:
            self._start_s = inf
            self._lock.start()
        for entry in self._timeline.due(self._lock.time_s):
            index = next(i for i, each in enumerate(self._entries) if each is entry)
            self._lock.record(TimelinePlayed(self._lock.time_s, index))
            self._carry_out(entry)
            self._listen()
            self._record.played += 1

    def _listen(self) -> None:
        self._downlink.listen(self._lock.time_s)
        if self._downlink.dark is not self._dark:
            self._dark = self._downlink.dark
            self._lock.record(LinkDarkChanged(self._lock.time_s, self._dark))

    def observe(self) -> None:
        """Sample the rover after a tick."""
        time_s = self._lock.time_s
        self._record.poses.append(TruePose(time_s, self._lock.rover.true_pose))
        if self.in_contact:
            self._lock.executive.ground.record_contact()
        if self._lock.alive:
            self._record.modes.append(ModeSample(time_s, self._lock.executive.mode))

    def _carry_out(self, entry: Entry) -> None:
        lock, record = self._lock, self._record
        match entry:
            case model.Send() | model.Repeat():
                self._send(entry)
            case model.Fix(fix=label):
                self._send(model.Send(command=self._compensation(), label=label))
            case model.QueryParameters(query=label):
                values = record.received_values(
                    lock.executive.parameters() if self.in_contact else ()
                )
                files = tuple(lock.executive.files.paths()) if self.in_contact else ()
                record.answers.append(QueryAnswer(label, values, files))
            case model.Fetch(fetch=path):
                record.fetched.append(self._read(path))
            case model.Inject(inject=fault):
                self._set_fault(type(fault), fault)
            case model.Clear(clear=kind):
                self._set_fault(kind, None)
            case model.Cargo(cargo_kg=mass_kg):
                lock.rover.set_cargo_mass(mass_kg)
                lock.record(CargoChanged(lock.time_s, mass_kg))
            case model.Outage(outage_s=dark_s):
                self._downlink.start_outage(lock.time_s + dark_s)
            case model.Crash(crash_s=down_s):
                if lock.alive:
                    lock.kill()
                self._start_s = lock.time_s + down_s
            case _:
                assert_never(entry)

    def _send(self, entry: model.Send | model.Repeat) -> None:
        label, command = self._ground.command(entry, self._lock.clock.utc_s())
        answer = self.submit(command)
        self._record.sendings.append(
            SentCommand(label, command.identity, self._lock.time_s, answer)
        )
        if answer in (Answer.ACCEPTED, Answer.REJECTED):
            self._record.requested.append(AdmittedRequest(command.identity, command.request))

    def _compensation(self) -> SetPositionCompensation:
        """Return the compensation that makes the reported pose equal to the true one."""
        status, true = self._lock.executive.status, self._lock.rover.true_pose
        pose, now = status.pose, status.compensation
        turn_rad = wrap_rad(true.heading_rad - pose.heading_rad)
        x_m, y_m = now.x_m - pose.x_m, now.y_m - pose.y_m
        return SetPositionCompensation(
            true.x_m + x_m * cos(turn_rad) - y_m * sin(turn_rad),
            true.y_m + x_m * sin(turn_rad) + y_m * cos(turn_rad),
            true.z_m + now.z_m - pose.z_m,
            wrap_rad(now.heading_rad + turn_rad),
        )

    def _set_fault(self, kind: type[SimulatedFault], begins: SimulatedFault | None) -> None:
        """Inject a fault, or clear the fault of a kind."""
        time_s = self._lock.time_s
        self._lock.record(fault_changed(time_s, kind, begins))
        if kind is LinkLost:
            self._downlink.set_lost(begins is not None)
        elif begins is not None:
            self._lock.rover.inject(begins)
        else:
            self._lock.rover.clear(kind)
        name = fault_declaration(kind).name
        self._record.faults.append(FaultChange(time_s, name, begins is not None))

    def submit(self, command: Command) -> Answer:
        """Send a command, and return the answer."""
        if self._downlink.dark:
            return Answer.LOST
        try:
            admission = self._lock.submit(command)
        except ConnectionError:
            return Answer.LOST
        match admission:
            case Accepted():
                return Answer.ACCEPTED
            case Duplicate():
                return Answer.DUPLICATE
            case Rejected(refusal):
                reused = refusal.reason is Reason.DUPLICATE
                return Answer.DUPLICATE if reused else Answer.REJECTED
            case _:
                assert_never(admission)

    @property
    def in_contact(self) -> bool:
        """Whether an executive runs, and the link is up."""
        return self._lock.alive and not self._downlink.dark

    def _read(self, path: str) -> Fetched | FetchFailed:
        if not self.in_contact:
            return FetchFailed(path, "no contact")
        file = self._lock.executive.files.find(path)
        if isinstance(file, Refusal):
            return FetchFailed(path, file.text)
        octets = file.read_bytes()
        return Fetched(path, octets, octets, crc32(octets))
