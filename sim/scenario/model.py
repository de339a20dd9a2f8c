"""What a scenario file says: the surroundings, what is done when, and what must come of it.

Names and units follow the file: a field `x_m` is written `x` there, `heading_rad` is `heading` and
may be written in degrees (`90deg`).
"""

from dataclasses import dataclass, field
from enum import Enum, unique

from executive.commands import Request, declaration_of
from executive.settings import Settings, figure
from sim.rover import World
from sim.rover.body import MAX_CARGO_KG
from sim.rover.faults import SimulatedFault
from sim.rover.jackal import OdometrySettings
from sim.scenario.expect_commands import CommandExpectation
from sim.scenario.expect_rover import SHORTEST_S, RoverExpectation
from sim.scenario.record import Scheduled


@unique
class RunMode(Enum):
    """Where it is played, and by which link the ground speaks to the rover."""

    LOCK_STEP = "in lock step"
    """One process, simulated time; the link is the call of a function."""
    DIRECT = "by the direct link"
    """Real processes in real time; MAL on TCP."""
    RELAY = "by the relay"
    """The same, through an orbiter; MAL on TCP, then bundles."""

    @property
    def link(self) -> str:
        """The name of the link, as commands carry it."""
        return "relay" if self is RunMode.RELAY else "direct"


LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Send(Scheduled):
    """A command is sent.

    Attributes:
        label: what other entries and expectations call it; None is the operation's name.
        id: its number; None takes the place of the command among those of the file.
        link: by which it comes; None is that by which the scenario is played.
        lifetime_s: seconds after which it must not start any more.
        replace: whether it replaces the motion that it finds.
    """

    command: Request
    label: str | None = None
    id: int | None = figure(-(2**63), 2**63 - 1, default=None)
    source: str = "MOE"
    link: str | None = None
    lifetime_s: float | None = None
    replace: bool = False

    @property
    def name(self) -> str:
        """What other entries and expectations call it."""
        return self.label or declaration_of(type(self.command)).name


@dataclass(frozen=True, slots=True, kw_only=True)
class Fix(Scheduled):
    """The true pose is measured, and a position compensation sent with which it is reported.

    Attributes:
        fix: label of that `setPositionCompensation`.
    """

    fix: str

    @property
    def name(self) -> str:
        """What other entries and expectations call it."""
        return self.fix


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeat(Scheduled):
    """A command that was sent is sent once more, as it was, as a relay does that heard no answer.

    Attributes:
        repeat: its label.
        link: the link on which the repeat comes in; None is that of the first time.
    """

    repeat: str
    link: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class QueryParameters(Scheduled):
    """The present values of all parameters, and what files there are, are asked for."""

    ask: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Fetch(Scheduled):
    """A file aboard is fetched; in lock step, where nothing is transferred, it is read."""

    fetch: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Inject(Scheduled):
    """A fault begins."""

    inject: SimulatedFault


@dataclass(frozen=True, slots=True, kw_only=True)
class Clear(Scheduled):
    """A fault ends, of which the kind is named."""

    clear: type[SimulatedFault]


@dataclass(frozen=True, slots=True, kw_only=True)
class Crash(Scheduled):
    """The executive is lost as by kill -9.

    Attributes:
        crash_s: seconds until another is started on the same ledger.
    """

    crash_s: float = figure()


@dataclass(frozen=True, slots=True, kw_only=True)
class Cargo(Scheduled):
    """The rover carries so much from now on, in place of what it carried."""

    cargo_kg: float = figure(most=MAX_CARGO_KG)


@dataclass(frozen=True, slots=True, kw_only=True)
class Eclipse(Scheduled):
    """Nothing passes between ground and rover, which is on its own.

    By the direct link, what is sent meanwhile is lost; by the relay it waits. What the rover
    reported meanwhile is heard afterwards.

    Attributes:
        eclipse_s: seconds until there is contact again.
    """

    eclipse_s: float = figure(SHORTEST_S)


Expectation = CommandExpectation | RoverExpectation
"""How each kind is judged is its own method `judge`."""
Entry = Send | Fix | Repeat | QueryParameters | Fetch | Inject | Clear | Crash | Cargo | Eclipse


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """One file.

    Attributes:
        asset: name of the asset, or its YAML file.
        settings: those of the asset, with what the file changes in them.
        odometry: how good it is; of a rover on velocities, in lock step.
        seed: of all noise of the sensors.
        lasts_s: simulated seconds from start to end.
        false_executed: labels of the commands that are known to end EXECUTED although the rover is
            not where they were to bring it; each must.
    """

    title: str
    description: str = ""
    asset: str = "jackal"
    settings: Settings
    world: World
    odometry: OdometrySettings = field(default_factory=OdometrySettings)
    seed: int = figure(default=0)
    lasts_s: float = figure(SHORTEST_S, LONGEST_S)
    timeline: tuple[Entry, ...] = ()
    expect: tuple[Expectation, ...]
    false_executed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.expect:
            raise ValueError("expect: nothing is expected")
