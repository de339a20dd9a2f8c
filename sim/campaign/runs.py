"""`RunTable`: the data set of a campaign, a row for each run, as Parquet with typed access.

Rows are added in parts, and each part is written atomically. A run is in the data set once: parts
are written by the campaign alone, never by its workers.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, get_type_hints

import pyarrow as pa
import pyarrow.dataset as ds
import pyarrow.parquet as pq
from cattrs import Converter
from cattrs.strategies import configure_union_passthrough

from executive.settings import SettingsError
from executive.values.reasons import Reason
from sim.campaign.draws import ValueKind, VariedQuantity, quantities
from sim.campaign.model import Campaign, Scalar
from sim.campaign.run_filter import EVERYWHERE, RunFilter
from sim.campaign.worker import JobResult
from sim.scenario.outcome import RunMetrics

if TYPE_CHECKING:
    from pandas import DataFrame

FOLDER: Final = "runs"
VARY: Final = "vary."
"""Prefix of the columns of varied quantities."""
_ARROW: Final = {
    ValueKind.NUMBER: pa.float64(),
    ValueKind.WHOLE: pa.int64(),
    ValueKind.TEXT: pa.string(),
    float | None: pa.float64(),
    float: pa.float64(),
    int | None: pa.int64(),
    int: pa.int64(),
    tuple[Reason, ...]: pa.list_(pa.string()),
}
_FIGURES: Final[dict[str, Any]] = get_type_hints(RunMetrics)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignRun(JobResult):
    """One run.

    Attributes:
        scenario: name as in the campaign.
        varied: value of each varied quantity; None if its fault has no such parameter.
        command: command that repeats it.
    """

    scenario: str
    varied: Mapping[str, Scalar | None]
    command: str


def keys_of(campaign: Campaign) -> dict[str, bool]:
    """Return the keys for conditions and quantiles, with whether each is a number."""
    figures = {name: True for name, kind in _FIGURES.items() if kind != tuple[Reason, ...]}
    varied = {each.name: each.kind is not ValueKind.TEXT for each in quantities(campaign)}
    return {"scenario": False, **figures, **varied}


class RunTable:
    """The data set in a folder.

    Args:
        folder: folder of the campaign; the data set is its folder `runs`.
    """

    def __init__(self, folder: Path, varied: Sequence[VariedQuantity]) -> None:
        self._folder = folder / FOLDER
        self._varied = tuple(varied)
        self._schema = _schema(self._varied)
        self._folder.mkdir(parents=True, exist_ok=True)
        for rest in self._folder.glob("*.unfinished"):
            rest.unlink()

    def add(self, runs: Sequence[CampaignRun]) -> None:
        """Write runs as one more part, durably; the same part again changes nothing.

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
                " can be, --resume executes the missing ones"
            ) from error

    @property
    def parts(self) -> list[Path]:
        """The files of the data set."""
        return sorted(self._folder.glob("*.parquet"))

    def numbers(self) -> list[int]:
        """Return the numbers of the existing runs.

        Raises:
            SettingsError: a number is duplicate, or the data set cannot be read.
        """
        found = self.frame().index
        if found.has_duplicates:
            twice = found[found.duplicated()][0]
            raise SettingsError(f"{self._folder}: run {twice} is duplicate; begin in a new --out")
        return list(found)

    def frame(self, *keys: str, where: RunFilter = EVERYWHERE) -> "DataFrame":
        """Return columns of the runs, indexed by run number; missing values are NA.

        Args:
            keys: keys of `keys_of`, or other fields of `CampaignRun`.
            where: filter of the runs.

        Raises:
            SettingsError: the data set cannot be read.
        """
        from pandas import ArrowDtype  # not needed to read a campaign's file

        names = {self._column(key): key for key in (*keys, *(each.key for each in where.terms))}
        table = self._table(["run", *names]).to_pandas(types_mapper=ArrowDtype)
        return where.of(table.rename(columns=names).set_index("run").sort_index())

    def read(self, where: RunFilter = EVERYWHERE, *, failed: bool = False) -> Iterator[CampaignRun]:
        """Yield runs by number.

        Args:
            where: filter of the runs.
            failed: only those that failed.
        """
        passed = self.frame("passed", where=where)["passed"]
        yield from self.at(passed.index[~passed] if failed else passed.index)

    def at(self, numbers: Iterable[int]) -> Iterator[CampaignRun]:
        """Yield the runs with these numbers, by number."""
        table = self._table(None, ds.field("run").isin(list(numbers))).sort_by("run")
        for batch in table.to_batches(max_chunksize=1000):
            yield from map(self._run, batch.to_pylist())

    def _run(self, row: dict[str, Any]) -> CampaignRun:
        varied = {each.name: row[VARY + each.name] for each in self._varied}
        return _converter().structure({**row, "varied": varied, "figures": row}, CampaignRun)

    def _column(self, key: str) -> str:
        return VARY + key if VARY + key in self._schema.names else key

    def _table(self, columns: list[str] | None, condition: Any = None) -> Any:
        if not self.parts:
            return self._schema.empty_table().select(columns or self._schema.names)
        try:
            found = ds.dataset([str(part) for part in self.parts], schema=self._schema)
            return found.to_table(columns=columns, filter=condition)
        except (OSError, pa.ArrowException) as error:
            raise SettingsError(f"{self._folder}: is no data set of runs ({error})") from error


def _schema(varied: Sequence[VariedQuantity]) -> Any:
    return pa.schema(
        [
            ("run", pa.int64()),
            ("scenario", pa.string()),
            ("seed", pa.int64()),
            *((VARY + each.name, _ARROW[each.kind]) for each in varied),
            *((name, _ARROW[kind]) for name, kind in _FIGURES.items()),
            ("passed", pa.bool_()),
            ("failed_findings", pa.list_(pa.string())),
            ("digest", pa.string()),
            ("seconds", pa.float64()),
            ("command", pa.string()),
        ]
    )


def _row(run: CampaignRun) -> dict[str, Any]:
    row: dict[str, Any] = _converter().unstructure(run)
    varied = {VARY + name: value for name, value in row.pop("varied").items()}
    return {**row.pop("figures"), **varied, **row}


@cache
def _converter() -> Converter:
    """Return the converter between runs and rows, with reasons by name."""
    converter = Converter()
    converter.register_unstructure_hook(Reason, lambda reason: reason.name)
    converter.register_structure_hook(Reason, lambda name, _: Reason[name])
    configure_union_passthrough(Scalar | None, converter)
    return converter
