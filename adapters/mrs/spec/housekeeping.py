"""Housekeeping parameters on the wire, for executive, orbiter and console, with their limits."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

from adapters.mal import AttributeType
from adapters.mrs.spec.mapping import AssetView, figure_value, figures
from adapters.mrs.spec.types import CameraState, ParameterDefinition, ParameterValue
from adapters.process import ResourceUsage
from executive.commands import Limit
from executive.settings import Settings
from executive.state import PROMISED_M, PROMISED_RAD, Uncertainty
from executive.values.geometry import Pose
from executive.values.parameters import Parameter
from executive.values.reasons import Figure, Refusal
from executive.values.reports import Report, ReportKind

MIN_FREE_OCTETS: Final = 100_000_000
"""Minimum free octets of a disk, below it an alarm; chosen, not measured."""
MAX_COMMIT_WAIT_S: Final = 1.0
"""Maximum wait for the disk, above it an alarm; chosen, not measured."""


@dataclass(frozen=True, slots=True)
class HousekeepingParameter:
    """A housekeeping parameter of a process.

    Attributes:
        low, high: limits for an alarm: a figure, or the path of a setting of the asset; None for
            no limit.
    """

    name: str
    description: str
    unit: str | None = None
    low: Limit | None = None
    high: Limit | None = None

    @property
    def definition(self) -> ParameterDefinition:
        """Its definition in the MRS."""
        return ParameterDefinition(
            name=self.name,
            description=self.description,
            type=AttributeType.DOUBLE,
            unit=self.unit,
            writable=False,
        )


def display_name(definition: ParameterDefinition) -> str:
    """Return the name of a parameter for operators, by its description: Battery voltage."""
    name = definition.description.removeprefix("Current ") or definition.name
    return name[0].upper() + name[1:]


def _of_process(prefix: str, component: str) -> tuple[HousekeepingParameter, ...]:
    return (
        HousekeepingParameter(f"{prefix}_MEMORY", f"Memory of {component}", "B"),
        HousekeepingParameter(f"{prefix}_CPU", f"Share of a processor core used by {component}"),
        HousekeepingParameter(
            f"{prefix}_DISK_FREE", f"Free space on the disk of {component}", "B", MIN_FREE_OCTETS
        ),
        HousekeepingParameter(f"{prefix}_UPTIME", f"Time since the start of {component}", "s"),
    )


def usage_figures(prefix: str, usage: ResourceUsage) -> dict[str, float | None]:
    """Return the resource usage of a process, by parameter name."""
    return {
        f"{prefix}_MEMORY": usage.memory_octets,
        f"{prefix}_CPU": usage.cpu_ratio,
        f"{prefix}_DISK_FREE": usage.disk_free_octets,
        f"{prefix}_UPTIME": usage.uptime_s,
    }


POSE_HOUSEKEEPING: Final = (
    HousekeepingParameter(
        "EXEC_POSITION_UNCERTAINTY",
        "Maximum distance of the rover from its reported position",
        "m",
        high=PROMISED_M,
    ),
    HousekeepingParameter(
        "EXEC_HEADING_UNCERTAINTY",
        "Maximum angle of the rover from its reported heading",
        "rad",
        high=PROMISED_RAD,
    ),
)
"""Parameters of the executive for the uncertainty of the pose."""

MAP_HOUSEKEEPING: Final = (
    HousekeepingParameter("EXEC_MAP_X", "Origin of the map X, in the frame of the position", "m"),
    HousekeepingParameter("EXEC_MAP_Y", "Origin of the map Y, in the frame of the position", "m"),
    HousekeepingParameter("EXEC_MAP_HEADING", "Heading of the map, in the same frame", "rad"),
)
"""Parameters of the executive for the map; no values without a recent transform of it."""

EXECUTIVE: Final = "EXEC"
EXECUTIVE_HOUSEKEEPING: Final = (
    HousekeepingParameter(
        "EXEC_TICK", "Maximum tick time of the last seconds", "s", high="safety.watchdog_s"
    ),
    HousekeepingParameter(
        name="EXEC_TICK_PERIOD",
        description="Maximum time from one tick to the next in the last seconds",
        unit="s",
        high="safety.watchdog_s",
    ),
    HousekeepingParameter("EXEC_OVERRUNS", "Late ticks since the start"),
    HousekeepingParameter("EXEC_QUEUED", "Commands and queries queued for the core"),
    HousekeepingParameter("EXEC_GOALS", "Accepted commands, queued or active"),
    HousekeepingParameter("EXEC_LEDGER", "Size of the ledger on the disk", "B"),
    HousekeepingParameter("EXEC_UNWRITTEN", "Commits of the ledger that wait for the disk"),
    HousekeepingParameter(
        "EXEC_COMMIT_WAIT", "Waiting time of the first report of them", "s", high=MAX_COMMIT_WAIT_S
    ),
    HousekeepingParameter("EXEC_REPORTS", "Sequence number of the last report"),
    *POSE_HOUSEKEEPING,
    *MAP_HOUSEKEEPING,
    *_of_process(EXECUTIVE, "rover-executive"),
)
"""Parameters of the executive."""


def uncertainty_figures(figures: Sequence[Figure]) -> dict[str, float]:
    """Return the uncertainty of the pose in some figures, by parameter name."""
    values = {each.name: each.value for each in figures}
    named = zip(Uncertainty().figures, POSE_HOUSEKEEPING, strict=True)
    return {each.name: values[figure.name] for figure, each in named if figure.name in values}


def map_figures(origin: Pose | Refusal) -> dict[str, float]:
    """Return the origin of the map, by parameter name; empty if it is unknown."""
    if isinstance(origin, Refusal):
        return {}
    figures = origin.x_m, origin.y_m, origin.heading_rad
    return {each.name: figure for each, figure in zip(MAP_HOUSEKEEPING, figures, strict=True)}


def reported_uncertainty(report: Report) -> dict[str, float]:
    """Return the uncertainty of the pose in an event report; empty if it has none.

    Events without a reason are ignored: a client may have sent them.
    """
    of_core = report.kind is ReportKind.EVENT and report.reason is not None
    return uncertainty_figures(report.figures) if of_core else {}


NXT_HOUSEKEEPING: Final = (
    HousekeepingParameter("NXT_CONNECTED", "Connection of MOCUP's brick: 1 or 0", None, 1),
    HousekeepingParameter("NXT_QUEUED", "Commands of the relay queued for the brick"),
    HousekeepingParameter("NXT_COMMANDS", "Commands received by rover-nxt since its start"),
    HousekeepingParameter("NXT_REPEATS", "Repeated commands since its start"),
    HousekeepingParameter("NXT_REFUSED", "Rejected messages since its start"),
    HousekeepingParameter("NXT_DEAD_MAN", "Dead-man stops since its start"),
)
"""Parameters of `rover-nxt`, the process that drives MOCUP's brick."""

ABOARD_HOUSEKEEPING: Final = (*EXECUTIVE_HOUSEKEEPING, *NXT_HOUSEKEEPING)
"""Parameters of the onboard processes; those of a missing process have no value."""

ORBITER: Final = "ORBITER"
ORBITER_HOUSEKEEPING: Final = _of_process(ORBITER, "rover-mops")
"""Parameters of the orbiter, over the relay link."""

CONSOLE: Final = "CONSOLE"
CONSOLE_HOUSEKEEPING: Final = (
    HousekeepingParameter("CONSOLE_PAGES", "Open pages"),
    HousekeepingParameter("CONSOLE_DROPPED", "Values dropped for slow pages since the start"),
    HousekeepingParameter("CONSOLE_QUEUED", "Messages queued for the archive"),
    HousekeepingParameter("CONSOLE_LOST", "Messages lost by the archive since the start", high=0),
    HousekeepingParameter("CONSOLE_SAMPLES", "Values written to the archive per second", "1/s"),
    *_of_process(CONSOLE, "rover-console"),
)
"""Parameters of an operator console, shown on its own pages."""


def housekeeping_values(
    parameters: Iterable[HousekeepingParameter],
    figures: Mapping[str, float | None],
    utc_s: float,
) -> tuple[ParameterValue, ...]:
    """Return values for the wire from figures by name, INVALID without a figure.

    `utc_s` is the time of the measurement, seconds since 1970-01-01 UTC.
    """
    return tuple(
        figure_value(parameter.name, figures.get(parameter.name), utc_s) for parameter in parameters
    )


def housekeeping_limits(
    settings: Settings | None,
) -> dict[str, tuple[float | None, float | None]]:
    """Return the low and high limits of housekeeping, by parameter name.

    Without settings, limits that are settings are None.
    """

    def figure(limit: Limit | None) -> float | None:
        if not isinstance(limit, str):
            return limit
        return None if settings is None else attrgetter(limit)(settings)

    return {
        each.name: (figure(each.low), figure(each.high))
        for each in (*ABOARD_HOUSEKEEPING, *ORBITER_HOUSEKEEPING, *CONSOLE_HOUSEKEEPING)
    }


def camera_state(asset: AssetView, video_on: bool) -> CameraState:
    """Return the angles of the camera, NaN if unknown, and whether its video is forwarded."""
    figure = figures(asset)
    return CameraState(
        pan=figure[Parameter.CAM_PAN],
        tilt=figure[Parameter.CAM_TILT],
        rotateSpeed=figure[Parameter.CAM_ROTATE_SPEED],
        videoOn=video_on,
    )
