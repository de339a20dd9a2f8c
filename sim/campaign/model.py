"""`Campaign`: the content of a campaign file: scenarios, varied quantities, runs, criteria.

A field is named as its key in the file, see `sim.scenario.model`.
"""

from dataclasses import dataclass
from math import isfinite, prod
from typing import Final

from executive.settings import figure
from sim.campaign.run_filter import EVERYWHERE, RunFilter

MAX_RUNS: Final = 10_000_000

Scalar = str | int | float | bool
"""One value of YAML; a text is YAML itself, such as `5deg` or `[1, 2]`."""


@dataclass(frozen=True, slots=True)
class Interval:
    """An interval from a lower to a higher number."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise ValueError(f"[{self.low:g}, {self.high:g}] is no interval: LOW is not below HIGH")


@dataclass(frozen=True, slots=True)
class Uniform:
    """Uniform distribution over an interval."""

    uniform: Interval


@dataclass(frozen=True, slots=True)
class LogUniform:
    """Distribution over a positive interval, uniform in the logarithm."""

    log_uniform: Interval

    def __post_init__(self) -> None:
        if self.log_uniform.low <= 0:
            raise ValueError(f"log_uniform: {self.log_uniform.low:g} is not above 0")


@dataclass(frozen=True, slots=True)
class Normal:
    """A normal distribution, drawn again outside an interval.

    Attributes:
        normal: its mean and standard deviation.
        within: accepted values; None for all.
    """

    normal: tuple[float, ...]
    within: Interval | None = None

    def __post_init__(self) -> None:
        if len(self.normal) != 2 or self.normal[1] <= 0:
            raise ValueError("normal: expected [MEAN, STANDARD DEVIATION], the latter above 0")
        mean, deviation = self.normal
        near = Interval(mean - 2 * deviation, mean + 2 * deviation)
        if self.within is not None and (self.within.high < near.low or self.within.low > near.high):
            raise ValueError("within: is further than two standard deviations from the mean")


@dataclass(frozen=True, slots=True)
class Integers:
    """Uniform distribution over the integers from the first to the last."""

    integers: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.integers) != 2 or not self.integers[0] < self.integers[1] < 2**63:
            raise ValueError("integers: expected [FIRST, LAST], from a lower to a higher number")


Number = Uniform | LogUniform | Normal | Integers


@dataclass(frozen=True, slots=True)
class FaultDraw:
    """A fault to inject, with parameters that may be drawn.

    Attributes:
        name: name as in a scenario.
        parameters: name and value of each given parameter.
    """

    name: str
    parameters: tuple[tuple[str, Scalar | Number], ...] = ()


@dataclass(frozen=True, slots=True)
class Named:
    """A value with a name, which conditions and reports use."""

    name: str
    value: Scalar


Alternative = Scalar | Named | FaultDraw


@dataclass(frozen=True, slots=True)
class Choice:
    """One of several values, at random.

    Attributes:
        weights: relative probability of each value; None for equal ones.
    """

    choice: tuple[Alternative, ...]
    weights: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if len(self.choice) < 1:
            raise ValueError("choice: it is empty")
        weights = self.weights
        if weights is not None and (
            len(weights) != len(self.choice) or min(weights) < 0 or sum(weights) <= 0
        ):
            raise ValueError(f"weights: expected {len(self.choice)} numbers not below 0")


@dataclass(frozen=True, slots=True)
class Grid:
    """Each of several values, with equal frequency and with each value of every other grid."""

    grid: tuple[Alternative, ...]

    def __post_init__(self) -> None:
        if len(self.grid) < 1:
            raise ValueError("grid: it is empty")


Distribution = Number | Choice | Grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Variation:
    """A key of the scenarios that varies.

    Attributes:
        key: as in `rover scenario --set`.
        at: for `inject`, start of the fault in simulated seconds; 0 for all other keys.
        duration: for `inject`, duration of the fault in seconds; None if it does not end.
    """

    key: str
    distribution: Distribution
    at: Distribution | float = 0.0
    duration: Distribution | float | None = None

    @property
    def grids(self) -> tuple[tuple[str, Grid], ...]:
        """Column and grid of each part that is one."""
        parts = (
            (self.key, self.distribution),
            (f"{self.key}.at", self.at),
            (f"{self.key}.for", self.duration),
        )
        return tuple((name, part) for name, part in parts if isinstance(part, Grid))


@dataclass(frozen=True, slots=True, kw_only=True)
class Success:
    """A required share of runs meets all expectations of their scenario.

    Attributes:
        success: minimum share.
        confidence: confidence that the true share is not below it.
        where: filter of the runs.
    """

    success: float = figure(maximum=1.0)
    confidence: float = figure(0.5, 0.999999, default=0.95)
    where: RunFilter = EVERYWHERE

    def __post_init__(self) -> None:
        if self.success == 0:
            raise ValueError("success: 0 is met by any runs; give a share above 0")

    @property
    def bound(self) -> float:
        """The minimum share."""
        return self.success

    required_share = bound

    def __str__(self) -> str:
        return f"success at least {self.success:g}, confidence {self.confidence:g}{self.where}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantile:
    """A quantile of a figure is below, or above, a bound.

    Attributes:
        quantile: share of the runs with values up to the quantile.
        of: name of the figure.
        below, above: the bound; one of them.
        confidence: confidence that the true quantile meets the bound.
        where: filter of the runs. A run without the figure does not meet the bound.
    """

    quantile: float = figure(maximum=1.0)
    of: str
    below: float | None = None
    above: float | None = None
    confidence: float = figure(0.5, 0.999999, default=0.95)
    where: RunFilter = EVERYWHERE

    def __post_init__(self) -> None:
        if (self.below is None) == (self.above is None):
            raise ValueError("one of below, above is needed")
        if self.required_share == 0:
            side = "above 0" if self.above is None else "below 1"
            raise ValueError(f"quantile: {self.quantile:g} is met by any runs; give one {side}")

    @property
    def bound(self) -> float:
        """The given bound."""
        found = self.above if self.below is None else self.below
        assert found is not None
        return found

    @property
    def required_share(self) -> float:
        """Share of the runs that must meet the bound."""
        return self.quantile if self.above is None else 1 - self.quantile

    def __str__(self) -> str:
        side = f"above {self.above:g}" if self.below is None else f"below {self.below:g}"
        return (
            f"{self.quantile:g} quantile of {self.of} {side},"
            f" confidence {self.confidence:g}{self.where}"
        )


Criterion = Success | Quantile


@dataclass(frozen=True, slots=True, kw_only=True)
class Until:
    """Runs continue until the success rate is known well enough.

    Attributes:
        until: maximum width of the confidence interval of the success rate.
        min, max: bounds of the number of runs.
    """

    until: float = figure(1e-6, 1.0)
    confidence: float = figure(0.5, 0.999999, default=0.95)
    min: int = figure(1, MAX_RUNS, default=100)
    max: int = figure(1, MAX_RUNS, default=100_000)

    def __post_init__(self) -> None:
        if self.max < self.min:
            raise ValueError(f"max: {self.max} is below min, {self.min}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """One campaign file.

    Attributes:
        scenarios: paths, or names of files in config/scenarios; all have the same number of runs.
        runs: number of runs; by default each combination of the grids once.
        vary: varied quantities; a world precedes the quantities of the world.
        criteria: criteria over all runs.
    """

    title: str
    description: str = ""
    scenarios: tuple[str, ...]
    runs: int | Until
    seed: int = figure(default=0)
    vary: tuple[Variation, ...] = ()
    criteria: tuple[Criterion, ...]

    @property
    def grids(self) -> tuple[tuple[str, Grid], ...]:
        """Column and values of each grid."""
        return tuple(grid for variation in self.vary for grid in variation.grids)

    @property
    def combinations(self) -> int:
        """Number of combinations of scenarios and grids."""
        return combinations(self.scenarios, self.vary)


def combinations(scenarios: tuple[str, ...], vary: tuple[Variation, ...]) -> int:
    """Return the number of combinations of scenarios and grids."""
    grids = (grid for variation in vary for _, grid in variation.grids)
    return prod(len(grid.grid) for grid in grids) * len(scenarios)
