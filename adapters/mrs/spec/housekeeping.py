"""Housekeeping of the components between operator and rover: parameters like those of the rover."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from adapters.mal import AttributeType
from adapters.mrs.spec.mapping import figure_value
from adapters.mrs.spec.types import ParameterDefinition, ParameterValue
from adapters.process import ResourceUsage
from executive.commands import Limit
from executive.settings import Settings
from executive.state import PROMISED_M, PROMISED_RAD, Uncertainty
from executive.values.reasons import Figure
from executive.values.reports import Report, ReportKind

LEAST_FREE_OCTETS: Final = 100_000_000
"""Of a disk, below which it is an alarm."""


@dataclass(frozen=True, slots=True)
class HousekeepingParameter:
    """A parameter of a component.

    Attributes:
        low, high: beyond which something is wrong: a figure, or the path of a setting of the asset;
            None for no bound.
    """

    name: str
    description: str
    unit: str | None = None
    low: Limit | None = None
    high: Limit | None = None

    @property
    def definition(self) -> ParameterDefinition:
        """How it is told of in the MRS."""
        return ParameterDefinition(
            name=self.name,
            description=self.description,
            type=AttributeType.DOUBLE,
            unit=self.unit,
            writable=False,
        )


def _of_process(prefix: str, component: str) -> tuple[HousekeepingParameter, ...]:
    return (
        HousekeepingParameter(f"{prefix}_MEMORY", f"Memory that {component} holds", "B"),
        HousekeepingParameter(f"{prefix}_CPU", f"Part of a processor core that {component} takes"),
        HousekeepingParameter(
            f"{prefix}_DISK_FREE", f"Free on the disk of {component}", "B", LEAST_FREE_OCTETS
        ),
        HousekeepingParameter(f"{prefix}_UPTIME", f"Time since {component} began", "s"),
    )


def usage_figures(prefix: str, usage: ResourceUsage) -> dict[str, float | None]:
    """Return what a process takes, by the names of its parameters."""
    return {
        f"{prefix}_MEMORY": usage.memory_octets,
        f"{prefix}_CPU": usage.cpu_ratio,
        f"{prefix}_DISK_FREE": usage.disk_free_octets,
        f"{prefix}_UPTIME": usage.uptime_s,
    }


POSE_HOUSEKEEPING: Final = (
    HousekeepingParameter(
        "EXEC_POSITION_UNCERTAINTY",
        "Distance that the rover may be from the reported position",
        "m",
        high=PROMISED_M,
    ),
    HousekeepingParameter(
        "EXEC_HEADING_UNCERTAINTY",
        "Angle that the rover may be from the reported heading",
        "rad",
        high=PROMISED_RAD,
    ),
)
"""Of the executive, how uncertain the pose of its rover is."""

EXECUTIVE: Final = "EXEC"
EXECUTIVE_HOUSEKEEPING: Final = (
    HousekeepingParameter(
        "EXEC_TICK", "Longest tick of the last seconds", "s", high="safety.watchdog_s"
    ),
    HousekeepingParameter(
        name="EXEC_TICK_PERIOD",
        description="Longest time from one tick to the next, of the last seconds",
        unit="s",
        high="safety.watchdog_s",
    ),
    HousekeepingParameter("EXEC_OVERRUNS", "Ticks that were late, since the start"),
    HousekeepingParameter("EXEC_WAITING", "Commands and questions that wait for the core"),
    HousekeepingParameter("EXEC_GOALS", "Accepted commands that wait or are under way"),
    HousekeepingParameter("EXEC_LEDGER", "Octets of the ledger on the disk", "B"),
    HousekeepingParameter("EXEC_REPORTS", "Number of the last report"),
    *POSE_HOUSEKEEPING,
    *_of_process(EXECUTIVE, "rover-executive"),
)
"""Of the executive."""


def uncertainty_figures(figures: Sequence[Figure]) -> dict[str, float]:
    """Return how uncertain figures say that the pose is, by the names of the parameters."""
    values = {each.name: each.value for each in figures}
    named = zip(Uncertainty().figures, POSE_HOUSEKEEPING, strict=True)
    return {each.name: values[figure.name] for figure, each in named if figure.name in values}


def reported_uncertainty(report: Report) -> dict[str, float]:
    """Return how uncertain an event says that the pose is; nothing of what says nothing of that.

    An event without a reason may be somebody else's.
    """
    of_core = report.kind is ReportKind.EVENT and report.reason is not None
    return uncertainty_figures(report.figures) if of_core else {}


NXT_HOUSEKEEPING: Final = (
    HousekeepingParameter("NXT_CONNECTED", "Whether MOCUP's brick is there: 1 or 0", None, 1),
    HousekeepingParameter("NXT_WAITING", "Commands of the relay that wait for the brick"),
    HousekeepingParameter("NXT_COMMANDS", "Commands that came to rover-nxt, since its start"),
    HousekeepingParameter("NXT_REPEATS", "Commands that came again, since then"),
    HousekeepingParameter("NXT_REFUSED", "Messages that went nowhere, since then"),
    HousekeepingParameter("NXT_DEAD_MAN", "Stops because nobody was left who moved it, since then"),
)
"""Of `rover-nxt`, the process before MOCUP's brick."""

ABOARD_HOUSEKEEPING: Final = (*EXECUTIVE_HOUSEKEEPING, *NXT_HOUSEKEEPING)
"""Of the processes aboard; one that is not there tells nothing."""

ORBITER: Final = "ORBITER"
ORBITER_HOUSEKEEPING: Final = _of_process(ORBITER, "rover-mops")
"""Of the orbiter, by the relay link."""

CONSOLE: Final = "CONSOLE"
CONSOLE_HOUSEKEEPING: Final = (
    HousekeepingParameter("CONSOLE_PAGES", "Pages that are open"),
    HousekeepingParameter("CONSOLE_DROPPED", "Values not sent to slow pages, since the start"),
    HousekeepingParameter("CONSOLE_WAITING", "Messages that wait to be written to the archive"),
    HousekeepingParameter(
        "CONSOLE_LOST", "Messages that the archive has lost, since the start", high=0
    ),
    HousekeepingParameter("CONSOLE_SAMPLES", "Values written to the archive in a second", "1/s"),
    *_of_process(CONSOLE, "rover-console"),
)
"""Of an operations console, which tells it to its own pages."""


def housekeeping_values(
    parameters: Iterable[HousekeepingParameter],
    figures: Mapping[str, float | None],
    utc_s: float,
) -> tuple[ParameterValue, ...]:
    """Return values for the wire of figures by name, INVALID where there is no figure.

    They were measured at `utc_s`, seconds since 1970-01-01 UTC.
    """
    return tuple(
        figure_value(parameter.name, figures.get(parameter.name), utc_s) for parameter in parameters
    )


def housekeeping_limits(
    settings: Settings | None,
) -> dict[str, tuple[float | None, float | None]]:
    """Return between which values housekeeping may be, by the names of the parameters.

    Where the settings of the asset are not known, those that they say are not either.
    """

    def figure(limit: Limit | None) -> float | None:
        if not isinstance(limit, str):
            return limit
        return None if settings is None else attrgetter(limit)(settings)

    return {
        each.name: (figure(each.low), figure(each.high))
        for each in (*ABOARD_HOUSEKEEPING, *ORBITER_HOUSEKEEPING, *CONSOLE_HOUSEKEEPING)
    }
