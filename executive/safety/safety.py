"""`FaultMonitor` runs all monitors each tick, and determines which faults begin and end.

A fault begins when the evidence of one of its windows has persisted for the time of that window. It
ends when no window has evidence, or with a resume, according to its row. The reactions are in
`executive.core.reactions`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf
from typing import Final

from executive.faults import (
    DECLARED,
    ClearPolicy,
    Disproves,
    FaultResponse,
    MonitoredWhen,
    Reaction,
    Window,
)
from executive.safety import (
    asset_monitors,
    inertial_monitors,
    odometry_monitors,
    second_odometry_monitors,
    surroundings_monitors,
    wheel_monitors,
)
from executive.safety.evidence import Evidence, Monitor
from executive.safety.motion_history import MotionHistory
from executive.settings import LocomotionKind, Settings
from executive.values.clock import Clock
from executive.values.facts import Fact, Source
from executive.values.reasons import Reason, Refusal
from executive.values.reports import Severity

MONITORS: Final[Mapping[str, Monitor]] = {
    name: monitor
    for module in (
        asset_monitors,
        odometry_monitors,
        wheel_monitors,
        inertial_monitors,
        second_odometry_monitors,
        surroundings_monitors,
    )
    for name, monitor in vars(module).items()
    if name in DECLARED
} | {
    f"{each.name.lower()}_rejected": partial(asset_monitors.rejected, source=each)
    for each in Source
}
"""The monitor of each fault of the table: the function of its name."""

EXCLUDED_MONITORS: Final[Mapping[LocomotionKind, frozenset[str]]] = {
    LocomotionKind.VELOCITY: frozenset({"steady_off_command", "steady_turn_off_command"}),
    LocomotionKind.DELEGATED: frozenset(
        {"turn_angle_off_command", "uncommanded_travel", "uncommanded_turn"}
    ),
}
"""Faults that are not monitored on a kind of rover.

A rover that accepts velocities is compared with each command. A rover of delegated motion is
compared with the steady speed of each motion. It may have motion from another link, which the
executive does not know.
"""

EXPLAINED: Final[Mapping[str, Source]] = {
    **{f"{each.name.lower()}_silent": each for each in Source},
    **dict.fromkeys(("odometry_stale", "odometry_rate_low"), Source.ODOMETRY),
    **dict.fromkeys(("odometry_frozen", "off_command", "turn_off_command"), Source.VELOCITY),
    **dict.fromkeys(("wheels_off_command", "wheel_travel_off_command"), Source.VELOCITY),
    "no_progress": Source.VELOCITY,
}
"""Faults and their sources; the text of a fault includes why data of its source are rejected."""
HOLDING_REACTIONS: Final = frozenset({Reaction.PAUSE, Reaction.STOP, Reaction.SAFE})
SLIDING: Final = frozenset(
    {
        Reason.WHEEL_SLIP,
        Reason.WHEELS_OFF_GYRO,
        Reason.TRAVEL_SLIP,
        Reason.TURN_SLIP,
        Reason.SLIDE_AT_REST,
    }
)
"""Reasons of faults that show the rover moving otherwise than its wheels."""
SLID_S: Final = 1.5
"""Duration of such evidence: longer than the fault and its window."""
FOREIGN_INPUT_FAULT: Final = "other_publisher"
UNMONITORED: Final = FaultResponse(MonitoredWhen.ALWAYS, Reaction.SAFE, ClearPolicy.ON_RESUME)
"""Row of faults without a monitor; a resume cannot check their cause."""
CLEAR_AFTER_S: Final = 0.5
"""Time without evidence after which a fault ends by itself."""


@dataclass(slots=True)
class Fault:
    """A fault that has begun and is not over.

    Attributes:
        refusal: its reason, with its evidence when it began; commands fail with it.
        begun_utc_s: when it began.
        last_evidence_s: time of the last evidence.
    """

    name: str
    row: FaultResponse
    refusal: Refusal
    begun_utc_s: float
    last_evidence_s: float

    @property
    def severity(self) -> Severity:
        """The severity for the operator."""
        return (
            Severity.ALARM
            if self.row.reaction in {Reaction.STOP, Reaction.SAFE}
            else Severity.WARNING
        )

    @property
    def disproves(self) -> Disproves | None:
        """How the pose may be wrong; None if it may not, as by faults outside of the table."""
        declared = DECLARED.get(self.name)
        return None if declared is None else declared.disproves

    def __str__(self) -> str:
        return f"{self.severity.name} {self.name}: {self.refusal.text}"


@dataclass(frozen=True, slots=True)
class FaultChanges:
    """The faults that began and ended in one check."""

    begun: tuple[Fault, ...] = ()
    ended: tuple[Fault, ...] = ()


@dataclass(slots=True)
class _FaultWatch:
    """One window of a fault, and since when evidence has persisted."""

    name: str
    row: FaultResponse
    window: Window
    monitor: Monitor
    always: bool
    since_s: float | None = field(default=None)


class FaultMonitor:
    """The monitors of an asset.

    Attributes:
        history: their input.
        active: the faults that have begun and are not over, in order of their start.
    """

    def __init__(self, clock: Clock, settings: Settings) -> None:
        self._clock = clock
        self.history = MotionHistory(clock, settings)
        self.active: list[Fault] = []
        self._distrusted = False
        self._slid: Fault | None = None
        self._rows = {
            declared.name: row
            for declared, row in settings.faults
            if row.reaction is not Reaction.IGNORE
            and declared.name not in EXCLUDED_MONITORS[settings.locomotion]
        }
        self._watches = tuple(
            _FaultWatch(name, row, window, MONITORS[name], row.when is MonitoredWhen.ALWAYS)
            for name, row in self._rows.items()
            for window in row.windows
        )
        self._at_rest = tuple(each for each in self._watches if each.always)
        self._rested = False

    def check(self, moving: bool) -> FaultChanges:
        """Check all monitors.

        Args:
            moving: whether a command that moves the rover is in execution.
        """
        now_s, history = self._clock.now_s(), self.history
        if moving and history.motion_since_s == inf and self._distrusted:
            history.begun_s, self._distrusted = now_s, False  # residual motion is no evidence
        history.motion_since_s = min(history.motion_since_s, now_s) if moving else inf
        changes = FaultChanges(
            tuple(self._new_faults(now_s, moving)), tuple(self._ended_faults(now_s))
        )
        holding = any(each.row.reaction in HOLDING_REACTIONS for each in self.active)
        self._distrusted |= holding or bool(changes.ended)
        for fault in (*changes.ended, *self.active):
            if fault.refusal.reason in SLIDING:
                self._slid = fault
        return changes

    @property
    def held_until_resume(self) -> bool:
        """Whether a fault other than the robot's own emergency stop holds until a resume."""
        return any(
            each.row.reaction in {Reaction.STOP, Reaction.SAFE}
            and each.row.clears is ClearPolicy.ON_RESUME
            and each.refusal.reason is not Reason.EMERGENCY_STOP
            for each in self.active
        )

    def unresolved_cause(self) -> Refusal | None:
        """Return the fault that a resume cannot clear because its cause persists, or None."""
        now_s = self._clock.now_s()
        latched = [each.name for each in self.active if each.row.clears is ClearPolicy.ON_RESUME]
        for watch in (each for name in latched for each in self._watches if each.name == name):
            evidence = watch.monitor(self.history, watch.window, now_s)
            if evidence is not None:
                return self._refusal(watch.name, evidence)
        return None

    @property
    def self_clearing(self) -> bool:
        """Whether all faults that hold the rover end by themselves."""
        holding = [each for each in self.active if each.row.reaction in HOLDING_REACTIONS]
        return bool(holding) and all(each.row.clears is ClearPolicy.AUTO for each in holding)

    def hold(self, why: Refusal, then: Reaction) -> Fault:
        """Begin a fault without a monitor, such as a failing ledger; a resume ends it."""
        return self.restore(why.reason.name.lower(), then, why, self._clock.utc_s())

    def restore(self, name: str, then: Reaction, why: Refusal, begun_utc_s: float) -> Fault:
        """Begin a fault that only a resume ends, replacing one of its name; return it."""
        row = replace(
            self._rows.get(name, UNMONITORED), reaction=then, clears=ClearPolicy.ON_RESUME
        )
        why = replace(why, fault=name)
        fault = Fault(name, row, why, begun_utc_s, self._clock.now_s())
        self.drop(name)
        self.active.append(fault)
        return fault

    def drop(self, name: str) -> None:
        """Remove a fault without a report."""
        self.active = [each for each in self.active if each.name != name]

    @property
    def sliding(self) -> Fault | None:
        """The last fault with a sliding rover, for `SLID_S`."""
        slid = self._slid
        return (
            slid
            if slid is not None and self._clock.now_s() - slid.last_evidence_s <= SLID_S
            else None
        )

    def resume(self) -> tuple[Fault, ...]:
        """End the faults that a resume clears, and return them."""
        ended = tuple(each for each in self.active if each.row.clears is ClearPolicy.ON_RESUME)
        self.active = [each for each in self.active if each.row.clears is ClearPolicy.AUTO]
        return ended

    def observe(self, fact: Fact) -> None:
        """Add a fact."""
        self.history.observe(fact)

    @property
    def _foreign_input_active(self) -> bool:
        """Whether motion waits while another publisher drives the base.

        The motion then differs from the commands here, which is no fault of the rover.
        """
        if (
            FOREIGN_INPUT_FAULT not in self._rows
            or self._rows[FOREIGN_INPUT_FAULT].reaction not in HOLDING_REACTIONS
        ):
            return False
        return any(each.input.overrides for each in self.history.drivers)

    def _new_faults(self, now_s: float, moving: bool) -> Iterator[Fault]:
        known = {fault.name: fault for fault in self.active}
        taken = self._foreign_input_active
        held = any(fault.row.reaction in HOLDING_REACTIONS for fault in self.active)
        # At rest the others have no evidence, which the first check notes.
        watches = self._at_rest if self._rested and not (moving or known) else self._watches
        self._rested = not (moving or known)
        for watch in watches:
            evidence = None
            if (
                taken
                and watch.row.when is MonitoredWhen.MOVING
                and watch.name != FOREIGN_INPUT_FAULT
            ):
                watch.since_s = None
                continue
            if moving or watch.always or watch.name in known:
                evidence = watch.monitor(self.history, watch.window, now_s)
            if evidence is None:
                watch.since_s = None
                continue
            if watch.name in known:
                known[watch.name].last_evidence_s = now_s
                continue
            if watch.since_s is None:
                watch.since_s = now_s
            holds = watch.row.reaction in HOLDING_REACTIONS
            if held and (not holds or watch.row.when is MonitoredWhen.MOVING):
                continue
            if now_s - watch.since_s >= watch.window.for_s - 1e-9:
                why, utc_s = self._refusal(watch.name, evidence), self._clock.utc_s()
                fault = Fault(watch.name, watch.row, why, utc_s, now_s)
                self.active.append(fault)
                known[watch.name] = fault
                if holds:
                    held, self.history.begun_s = True, now_s
                yield fault

    def _ended_faults(self, now_s: float) -> Iterator[Fault]:
        for fault in tuple(self.active):
            if (
                fault.row.clears is ClearPolicy.AUTO
                and now_s - fault.last_evidence_s >= CLEAR_AFTER_S - 1e-9
            ):
                self.active.remove(fault)
                yield fault

    def _refusal(self, name: str, evidence: Evidence) -> Refusal:
        text = self.history.rejections.explain(evidence.text, EXPLAINED.get(name))
        return Refusal(DECLARED[name].reason, text, evidence.figures, fault=name)
