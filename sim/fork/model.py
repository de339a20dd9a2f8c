"""`Change` of a recorded run, the input of a fork, and `ForkOutcome`, its result.

Times are seconds since the first entry of the recording. `ForkOutcome.document` is the JSON of
`rover whatif --json`.
"""

from dataclasses import asdict, dataclass
from enum import Enum, unique
from typing import Any

from adapters.recording.replayed import RecordedMessage
from executive.commands import PreemptionPolicy, Request
from executive.settings import Controller, Settings
from executive.values.geometry import Pose
from executive.values.reports import Identity
from sim.rover import World
from sim.rover.faults import SimulatedFault
from sim.scenario.changes import Override
from sim.scenario.record import Record, TruePose


@unique
class Placing(Enum):
    """How the simulated rover was put where the recorded one was; more exact ones are first."""

    PHYSICS = "physics from the start of the recording"
    STATE = "recorded state of the simulation"
    TRUE_POSE = "true pose"
    ODOMETRY = "pose of the odometry"


@unique
class Fidelity(Enum):
    """To what level a fork without a change reproduces the recording."""

    BIT_EQUAL = "bit-equal"
    """All decisions of the core and all true poses are the same."""
    SAME_OUTCOMES = "same outcomes"
    """Each command ends in the same stage for the same reason."""
    DIFFERENT = "different"
    NOT_COMPARED = "not compared"
    """The fork begins at the end of the recording: only the replay is the same."""


@dataclass(frozen=True, slots=True)
class AddedCommand:
    """A command that the recording does not have; sent at the fork, or at a time."""

    request: Request
    at_s: float | None = None
    preemption: PreemptionPolicy = PreemptionPolicy.APPEND


@dataclass(frozen=True, slots=True)
class ReplacedCommand:
    """A recorded command that is sent with another request."""

    identity: Identity
    request: Request


@dataclass(frozen=True, slots=True)
class AddedFault:
    """A simulated fault with its begin; without an end it lasts to the end of the fork."""

    fault: SimulatedFault
    begin_s: float
    end_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Changes of a fork; empty for the fork without a change.

    Attributes:
        asset: settings instead of the recorded ones; None for those.
        settings: keys of the settings and their values, such as `drive.travel_speed=0.6`.
        controller: controller of all motions that name one or may have one; None for no change.
        world: world instead of the recorded one; None for that.
        scans: whether the world is level ground with the obstacles that the laser measured.
        seed: seed of the noise instead of the recorded one; the fork is then not exact.
        added, dropped, replaced: commands.
        without: names of recorded faults that do not happen, as in scenario files.
        faults: further faults.
    """

    asset: Settings | None = None
    settings: tuple[Override, ...] = ()
    controller: Controller | None = None
    world: World | None = None
    scans: bool = False
    seed: int | None = None
    added: tuple[AddedCommand, ...] = ()
    dropped: tuple[Identity, ...] = ()
    replaced: tuple[ReplacedCommand, ...] = ()
    without: tuple[str, ...] = ()
    faults: tuple[AddedFault, ...] = ()


@dataclass(frozen=True, slots=True)
class CommandOutcome:
    """Outcome of one command.

    Attributes:
        command: identity as text, `MOE:1`.
        name: of its operation; empty if the request is not known.
        stage: name of the last stage.
        reason: name of the reason; empty without one.
        text: text of the last report, with its figures.
        end_s: time of the last report.
        pose: pose of the rover then: true in simulations, else of the odometry.
    """

    command: str
    name: str
    stage: str
    reason: str
    text: str
    end_s: float
    pose: Pose | None

    @property
    def kind(self) -> tuple[str, str, str]:
        """Command, stage and reason: equal for equal outcomes."""
        return self.command, self.stage, self.reason


@dataclass(frozen=True, slots=True)
class TrackPoint:
    """Position by the odometry at a time."""

    time_s: float
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class FirstDifference:
    """The first decision of a fork that differs from that of the run without a change.

    Attributes:
        topic: topic of the recording, such as `/out/velocity_commanded`.
        recorded, forked: both decisions as text with figures; `nothing` for none. That of the fork
            without a change is the recorded one if it is bit-equal.
        recorded_why, forked_why: the last cause in the explanation of the rover's state then, with
            its figures, as in `rover why`; set in answers.
    """

    time_s: float
    topic: str
    recorded: str
    forked: str
    recorded_why: str = ""
    forked_why: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ForkOutcome:
    """Result of a fork, or of the recording itself.

    Attributes:
        at_s: time of the fork; None for the recording.
        placing: how the simulated rover was put there; None for the recording.
        seed: seed of the noise; None for the recording.
        end_s: time of the end.
        commands: outcome of each command, in the order of their receipt.
        pose: pose at the end: true in simulations, else of the odometry.
        contacts: contacts with rocks, walls and steps that began; None if unknown.
        track: the driven track.
        first_difference: of the fork against the recording; None if nothing differs.
        lacks: items that are missing for an exact fork, a line each.
    """

    at_s: float | None = None
    placing: Placing | None = None
    seed: int | None = None
    end_s: float
    commands: tuple[CommandOutcome, ...]
    pose: Pose | None
    contacts: int | None = None
    track: tuple[TrackPoint, ...] = ()
    first_difference: FirstDifference | None = None
    lacks: tuple[str, ...] = ()

    @property
    def kinds(self) -> tuple[tuple[str, str, str], ...]:
        """Kind of each command's outcome."""
        return tuple(each.kind for each in self.commands)


@dataclass(frozen=True, slots=True)
class ForkRun:
    """A fork, and its record for the judgements of scenarios; both have the same times.

    Attributes:
        odometry: pose of the odometry at each tick.
        decisions: every decision with its time.
    """

    outcome: ForkOutcome
    record: Record
    odometry: tuple[TruePose, ...]
    decisions: tuple[tuple[float, RecordedMessage], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class WhatIf:
    """Answer to a question: the recording, its fork without a change, and those with it.

    Attributes:
        fidelity: of the fork without a change; if it is `DIFFERENT`, there are no other forks.
        forks: with the change, one for each seed; none if nothing was changed.
    """

    recording: str
    recorded: ForkOutcome
    unchanged: ForkOutcome
    fidelity: Fidelity
    forks: tuple[ForkOutcome, ...]

    def document(self) -> dict[str, Any]:
        """Return it as JSON data; values are in SI units, named in the keys, enums by name."""
        return asdict(self, dict_factory=_json_object)


def _json_object(items: list[tuple[str, Any]]) -> dict[str, Any]:
    return {key: each.name if isinstance(each, Enum) else each for key, each in items}
