"""`Scenario`: the content of a scenario file: environment, timeline and expectations.

Names and units follow the file: a field `x_m` is written `x` there, `heading_rad` is `heading` and
may be written in degrees (`90deg`).
"""

from dataclasses import dataclass, field
from enum import Enum, unique

from executive.commands import Mode, OnlyAt, Request, declaration_of
from executive.settings import Settings, figure
from sim.rover import World
from sim.rover.body import MAX_CARGO_KG
from sim.rover.faults import SimulatedFault
from sim.rover.jackal import SimulatedOdometry
from sim.scenario.expect_commands import CommandExpectation
from sim.scenario.expect_rover import MIN_INTERVAL_S, RoverExpectation
from sim.scenario.record import Scheduled


@unique
class RunMode(Enum):
    """How a scenario is run, and the link between ground and rover."""

    LOCK_STEP = "in lock step"
    """One process, simulated time; the link is a function call."""
    DIRECT = "over the direct link"
    """Real processes in real time; MAL on TCP."""
    RELAY = "over the relay"
    """Real processes in real time, over an orbiter; MAL on TCP, then bundles."""

    @property
    def link(self) -> str:
        """Name of the link, as in commands."""
        return "relay" if self is RunMode.RELAY else "direct"


MAX_DURATION_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Send(Scheduled):
    """Sends a command.

    Attributes:
        label: reference for other entries and expectations; None is the operation's name.
        id: its number; None is its position among the commands of the file.
        link: link of the command; None is the link of the run.
        lifetime_s: seconds after which it must no longer start.
        replace: whether it replaces current and queued motion.
        only_at, only_after, only_mode: its precondition: bounds of the pose as typed
            (`3,2,0.5,90deg,10deg`), the label of another command, a mode.
    """

    command: Request
    label: str | None = None
    id: int | None = figure(-(2**63), 2**63 - 1, default=None)
    source: str = "MOE"
    link: str | None = None
    lifetime_s: float | None = None
    replace: bool = False
    only_at: OnlyAt | None = None
    only_after: str | None = None
    only_mode: Mode | None = None

    @property
    def name(self) -> str:
        """Label for other entries and expectations."""
        return self.label or declaration_of(type(self.command)).name


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix(Scheduled):
    """Sends the position compensation that makes the reported pose equal to the true one.

    Attributes:
        fix: label of that `setPositionCompensation`.
    """

    fix: str

    @property
    def name(self) -> str:
        """Label for other entries and expectations."""
        return self.fix


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeat(Scheduled):
    """Resends a sent command unchanged, as a relay does that received no answer.

    Attributes:
        repeat: its label.
        link: link of the repeat; None is the link of the first time.
    """

    repeat: str
    link: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryParameters(Scheduled):
    """Queries the present values of all parameters, and the list of files."""

    query: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetch(Scheduled):
    """Fetches a file aboard; in lock step it is read without a transfer."""

    fetch: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Inject(Scheduled):
    """Injects a fault."""

    inject: SimulatedFault


@dataclass(frozen=True, slots=True, kw_only=True)
class Clear(Scheduled):
    """Clears the fault of a kind."""

    clear: type[SimulatedFault]


@dataclass(frozen=True, slots=True, kw_only=True)
class Crash(Scheduled):
    """Terminates the executive as by kill -9.

    Attributes:
        crash_s: seconds until another is started on the same ledger.
    """

    crash_s: float = figure()


@dataclass(frozen=True, slots=True, kw_only=True)
class Cargo(Scheduled):
    """Sets the mass of the rover's cargo, in kg."""

    cargo_kg: float = figure(maximum=MAX_CARGO_KG)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outage(Scheduled):
    """Starts a contact outage between ground and rover.

    Commands sent during it are lost over the direct link, and stored over the relay. Reports made
    during it are received after its end.

    Attributes:
        outage_s: duration of the outage in seconds.
    """

    outage_s: float = figure(MIN_INTERVAL_S)


Expectation = CommandExpectation | RoverExpectation
"""Expectation of a file; its method `judge` evaluates it."""
Entry = Send | Fix | Repeat | QueryParameters | Fetch | Inject | Clear | Crash | Cargo | Outage


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One scenario file.

    Attributes:
        asset: name of the asset, or its YAML file.
        settings: settings of the asset with the overrides of the file.
        odometry: odometry errors; for a rover commanded by velocities, in lock step only.
        seed: seed of all sensor noise.
        duration_s: simulated seconds from start to end.
        false_executed: labels of the commands that must end EXECUTED although the rover is not at
            their target: a known false success.
    """

    title: str
    description: str = ""
    asset: str = "jackal"
    settings: Settings
    world: World
    odometry: SimulatedOdometry = field(default_factory=SimulatedOdometry)
    seed: int = figure(default=0)
    duration_s: float = figure(MIN_INTERVAL_S, MAX_DURATION_S)
    timeline: tuple[Entry, ...] = ()
    expect: tuple[Expectation, ...]
    false_executed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.expect:
            raise ValueError("expect: nothing is expected")
