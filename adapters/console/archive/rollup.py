"""Stores minimum and maximum of each minute's samples, for fast queries of long time spans.

Minutes are counted since 1970-01-01 UTC, by the onboard clock. Late samples and deletions update
their minutes, too.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import (
    BigInteger,
    ColumnElement,
    Connection,
    Select,
    Subquery,
    and_,
    case,
    func,
    literal,
    or_,
    select,
    union_all,
)

from adapters.console.archive.tables import SAMPLE, SAMPLE_MINUTE, UNKNOWN

MINUTE_US: Final = 60_000_000


@dataclass(slots=True)
class _Minute:
    low: float
    low_us: int
    high: float
    high_us: int

    def add(self, value: float, utc_us: int) -> None:
        self.low, self.low_us = min((self.low, self.low_us), (value, utc_us))
        high = min((-self.high, self.high_us), (-value, utc_us))
        self.high, self.high_us = -high[0], high[1]


def add_samples(connection: Connection, insert: Any, rows: Iterable[Mapping[str, Any]]) -> None:
    """Add new samples to their minutes.

    Args:
        connection: connection of the transaction that stored them.
        insert: insert statement of the SQL dialect for the table.
        rows: rows of the samples.
    """
    minutes: dict[tuple[int, int], _Minute] = {}
    for row in rows:
        value, utc_us = row["value"], row["utc_us"]
        if value is None:
            continue
        key = (row["parameter"], utc_us // MINUTE_US)
        if key in minutes:
            minutes[key].add(value, utc_us)
        else:
            minutes[key] = _Minute(value, utc_us, value, utc_us)
    if not minutes:
        return
    old, new = SAMPLE_MINUTE.c, insert.excluded
    is_lower = or_(new.low < old.low, and_(new.low == old.low, new.low_us < old.low_us))
    is_higher = or_(new.high > old.high, and_(new.high == old.high, new.high_us < old.high_us))
    connection.execute(
        insert.on_conflict_do_update(
            index_elements=[old.parameter, old.minute],
            set_={
                "low": case((is_lower, new.low), else_=old.low),
                "low_us": case((is_lower, new.low_us), else_=old.low_us),
                "high": case((is_higher, new.high), else_=old.high),
                "high_us": case((is_higher, new.high_us), else_=old.high_us),
            },
        ),
        [
            {
                "parameter": parameter,
                "minute": minute,
                "low": each.low,
                "low_us": each.low_us,
                "high": each.high,
                "high_us": each.high_us,
            }
            for (parameter, minute), each in minutes.items()
        ],
    )


def remake_minutes(connection: Connection, parameter: int, first_us: int, last_us: int) -> None:
    """Recompute the minutes of a time span from the stored samples."""
    first, last = first_us // MINUTE_US, last_us // MINUTE_US
    old = SAMPLE_MINUTE.c
    connection.execute(
        SAMPLE_MINUTE.delete().where(old.parameter == parameter, old.minute.between(first, last))
    )
    samples = samples_of([parameter], first * MINUTE_US, (last + 1) * MINUTE_US - 1)
    ranked = ranked_of(samples, MINUTE_US)
    low, high = (ranked.c.lowest == 1), (ranked.c.highest == 1)
    minutes = select(
        ranked.c.parameter,
        ranked.c.part,
        func.max(case((low, ranked.c.value))),
        func.max(case((low, ranked.c.utc_us))),
        func.max(case((high, ranked.c.value))),
        func.max(case((high, ranked.c.utc_us))),
    ).group_by(ranked.c.parameter, ranked.c.part)
    connection.execute(
        SAMPLE_MINUTE.insert().from_select([each.name for each in SAMPLE_MINUTE.c], minutes)
    )


def samples_of(numbers: Iterable[int], start_us: int, end_us: int) -> Select[Any]:
    """Return the query for numeric samples of parameters, by ids, within a time span."""
    return select(SAMPLE.c.parameter, SAMPLE.c.utc_us, SAMPLE.c.value).where(
        SAMPLE.c.parameter.in_(list(numbers)),
        SAMPLE.c.utc_us.between(start_us, end_us),
        SAMPLE.c.value.is_not(None),
    )


def gaps_of(
    numbers: Iterable[int], start_us: int, end_us: int, width_us: int, origin_us: int
) -> Select[Any]:
    """Return the query for the first unknown sample of each part of a time span."""
    return (
        select(SAMPLE.c.parameter, func.min(SAMPLE.c.utc_us).label("utc_us"))
        .where(
            SAMPLE.c.parameter.in_(list(numbers)),
            SAMPLE.c.utc_us.between(start_us, end_us),
            UNKNOWN,
        )
        .group_by(SAMPLE.c.parameter, _part(SAMPLE.c.utc_us, width_us, origin_us))
    )


def candidates_of(numbers: Iterable[int], start_us: int, end_us: int) -> Select[Any]:
    """Return the query for a subset of samples that includes the extremes of a time span.

    It has minimum and maximum of each whole minute, and all samples outside of whole minutes.
    """
    numbers = list(numbers)
    first = -(-start_us // MINUTE_US)
    last = (end_us + 1) // MINUTE_US - 1
    if first > last:
        return samples_of(numbers, start_us, end_us)
    whole = (SAMPLE_MINUTE.c.parameter.in_(numbers), SAMPLE_MINUTE.c.minute.between(first, last))
    minutes = SAMPLE_MINUTE.c
    found = union_all(
        select(minutes.parameter, minutes.low_us.label("utc_us"), minutes.low.label("value")).where(
            *whole
        ),
        # A sample that is both minimum and maximum is selected once: `ranked_of` finds extremes.
        select(minutes.parameter, minutes.high_us, minutes.high).where(
            *whole, minutes.high_us != minutes.low_us
        ),
        samples_of(numbers, start_us, first * MINUTE_US - 1),
        samples_of(numbers, (last + 1) * MINUTE_US, end_us),
    ).subquery()
    return select(found)


def ranked_of(samples: Select[Any], width_us: int, origin_us: int = 0) -> Subquery:
    """Return samples with their ranks in ascending and descending order, in parts of a time span.

    Of equal values the first in time ranks first.
    """
    found = samples.subquery()
    part = _part(found.c.utc_us, width_us, origin_us)
    within = (found.c.parameter, part)
    rank = func.row_number()
    rising = (found.c.value, found.c.utc_us)
    falling = (found.c.value.desc(), found.c.utc_us)
    return select(
        *found.c,
        part.label("part"),
        rank.over(partition_by=within, order_by=rising).label("lowest"),
        rank.over(partition_by=within, order_by=falling).label("highest"),
    ).subquery()


def _part(utc_us: ColumnElement[int], width_us: int, origin_us: int) -> ColumnElement[int]:
    return (utc_us - literal(origin_us, BigInteger)) // literal(width_us, BigInteger)
