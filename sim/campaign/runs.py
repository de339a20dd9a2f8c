"""The data set of a campaign: a row for each run, as Parquet, with typed access.

Rows are added in parts, each of which is there as a whole or not at all. A run is in the data set
once: a part is written by the campaign alone, never by those who play the runs.
"""

import operator
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, get_type_hints

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq

from executive.reasons import Reason
from executive.settings import SettingsError
from sim.campaign.draws import Kind, Quantity, quantities
from sim.campaign.model import Campaign, Scalar
from sim.campaign.where import COMPARISONS, EVERYWHERE, Term, Where
from sim.scenario.outcome import Figures

FOLDER: Final = "runs"
VARY: Final = "vary."
"""What the columns of varied quantities begin with."""
_ARROW: Final = {
    Kind.NUMBER: pa.float64(),
    Kind.WHOLE: pa.int64(),
    Kind.TEXT: pa.string(),
    float | None: pa.float64(),
    float: pa.float64(),
    int | None: pa.int64(),
    int: pa.int64(),
    tuple[Reason, ...]: pa.list_(pa.string()),
}
_TEXT: Final = pa.string()
_FIGURES: Final[dict[str, Any]] = get_type_hints(Figures)


@dataclass(frozen=True, slots=True)
class Run:
    """One run.

    Attributes:
        run: its number.
        scenario: as the campaign names it.
        seed: of the noise of its sensors.
        varied: value of each varied quantity; None where its fault has no such parameter.
        figures: of the run.
        holds: whether all is so as its scenario expects.
        failed_findings: what is not, in words.
        digest: of all that happened; equal for runs that are alike bit for bit.
        seconds: how long it took.
        command: what repeats it.
    """

    run: int
    scenario: str
    seed: int
    varied: Mapping[str, Scalar | None]
    figures: Figures
    holds: bool
    failed_findings: tuple[str, ...]
    digest: str
    seconds: float
    command: str


def keys_of(campaign: Campaign) -> dict[str, bool]:
    """Return all that conditions and quantiles can go by, and whether it is a number."""
    figures = {name: True for name, kind in _FIGURES.items() if kind != tuple[Reason, ...]}
    varied = {each.name: each.kind is not Kind.TEXT for each in quantities(campaign)}
    return {"scenario": False, **figures, **varied}


class Runs:
    """The data set in a folder.

    Args:
        folder: of the campaign; the data set is its folder `runs`.
        varied: what varies.
    """

    def __init__(self, folder: Path, varied: Sequence[Quantity]) -> None:
        self._folder = folder / FOLDER
        self._varied = tuple(varied)
        self._schema = _schema(self._varied)
        self._folder.mkdir(parents=True, exist_ok=True)
        for rest in self._folder.glob("*.unfinished"):
            rest.unlink()

    def add(self, runs: Sequence[Run]) -> None:
        """Write runs as one more part, durably; those of a part once more change nothing.

        Raises:
            SettingsError: they cannot be written.
        """
        if not runs:
            return
        ordered = sorted(runs, key=lambda run: run.run)
        table = pa.Table.from_pylist(list(map(_row, ordered)), schema=self._schema)
        name = f"{ordered[0].run:08d}.parquet"
        unfinished = self._folder / f"{name}.unfinished"
        try:
            with unfinished.open("wb") as file:
                pq.write_table(table, file)
                file.flush()
                os.fsync(file.fileno())
            unfinished.rename(self._folder / name)
        except OSError as error:
            raise SettingsError(
                f"{self._folder}: runs cannot be written ({error.strerror or error}); once they"
                " can be, --resume plays what is missing"
            ) from error

    @property
    def parts(self) -> list[Path]:
        """The files that there are."""
        return sorted(self._folder.glob("*.parquet"))

    def numbers(self) -> list[int]:
        """Return the numbers of the runs that are there.

        Raises:
            SettingsError: one is there twice, or the data set cannot be read.
        """
        found = self.column("run")
        if len(set(found)) < len(found):
            twice = next(run for run, next_one in pairwise(found) if run == next_one)
            raise SettingsError(f"{self._folder}: run {twice} is there twice; begin in a new --out")
        return found

    def column(self, key: str, where: Where = EVERYWHERE) -> list[Any]:
        """Return one value of each run, by number.

        Args:
            key: one of `keys_of`, or another field of `Run`.
            where: of which runs.
        """
        name = self._column(key)
        found: list[Any] = self._table(where, [name])[name].to_pylist()
        return found

    def read(self, where: Where = EVERYWHERE, *, failed: bool = False) -> Iterator[Run]:
        """Yield runs by number.

        Args:
            where: which.
            failed: only those that do not hold.
        """
        for batch in self._table(where, None, failed=failed).to_batches(max_chunksize=1000):
            yield from map(self._run, batch.to_pylist())

    def _run(self, row: dict[str, Any]) -> Run:
        figures = {name: _figure(row[name]) for name in _FIGURES}
        return Run(
            run=row["run"],
            scenario=row["scenario"],
            seed=row["seed"],
            varied={each.name: row[VARY + each.name] for each in self._varied},
            figures=Figures(**figures),
            holds=row["holds"],
            failed_findings=tuple(row["failed_findings"]),
            digest=row["digest"],
            seconds=row["seconds"],
            command=row["command"],
        )

    def _column(self, key: str) -> str:
        return VARY + key if VARY + key in self._schema.names else key

    def _table(self, where: Where, columns: list[str] | None, *, failed: bool = False) -> Any:
        if not self.parts:
            return self._schema.empty_table()
        try:
            found = ds.dataset([str(part) for part in self.parts], schema=self._schema)
            wanted = columns and [*{"run", *columns}]
            table = found.to_table(columns=wanted, filter=self._condition(where, failed))
            return table.sort_by("run")
        except (OSError, pa.ArrowException) as error:
            raise SettingsError(f"{self._folder}: is no data set of runs ({error})") from error

    def _condition(self, where: Where, failed: bool) -> Any:
        terms = [
            COMPARISONS[term.comparison](pc.field(self._column(term.key)), self._value(term))
            for term in where.terms
        ]
        if failed:
            terms.append(~pc.field("holds"))
        return reduce(operator.and_, terms) if terms else None

    def _value(self, term: Term) -> str | float:
        """Return with what a column is compared: a text, if it is one of texts."""
        if isinstance(term.value, str) or self._schema.field(self._column(term.key)).type != _TEXT:
            return term.value
        return f"{term.value:g}"


def _schema(varied: Sequence[Quantity]) -> Any:
    return pa.schema(
        [
            ("run", pa.int64()),
            ("scenario", pa.string()),
            ("seed", pa.int64()),
            *((VARY + each.name, _ARROW[each.kind]) for each in varied),
            *((name, _ARROW[kind]) for name, kind in _FIGURES.items()),
            ("holds", pa.bool_()),
            ("failed_findings", pa.list_(pa.string())),
            ("digest", pa.string()),
            ("seconds", pa.float64()),
            ("command", pa.string()),
        ]
    )


def _row(run: Run) -> dict[str, object]:
    plain = {each.name: getattr(run, each.name) for each in fields(Run)}
    varied, figures = plain.pop("varied"), plain.pop("figures")
    return {
        **plain,
        **{VARY + name: value for name, value in varied.items()},
        **{name: _plain(getattr(figures, name)) for name in _FIGURES},
    }


def _plain(value: Any) -> Any:
    return [reason.name for reason in value] if isinstance(value, tuple) else value


def _figure(value: Any) -> Any:
    return tuple(Reason[name] for name in value) if isinstance(value, list) else value
