"""`run_retention` deletes archived data periodically, by age and by size.

Age is measured by the console's clock, since that of a rover may be wrong. Objects, plans and open
alarms are never deleted. Nor is the last notification of each link: the console requests the later
ones by its cursor.
"""

import asyncio
import logging
from dataclasses import dataclass
from functools import partial
from typing import Final

from sqlalchemy import Connection, Delete, func, select
from sqlalchemy.exc import SQLAlchemyError

from adapters.console.archive.archive import Archive, to_us
from adapters.console.archive.queries import find_parameters
from adapters.console.archive.rollup import remake_minutes
from adapters.console.archive.tables import ALARM, COMMAND, NOTIFICATION, RECORD, SAMPLE

_LOG: Final = logging.getLogger(__name__)

DAY_S: Final = 86_400.0
CHECK_S: Final = 600.0
SAMPLE_OCTETS: Final = 40
"""Octets of one sample in the database, with its share of the index."""
ROW_OCTETS: Final = 120
"""Octets of one other row, without its body."""
REDUCTION_RATIO: Final = 0.9
"""Share of the size bound down to which data is deleted once the bound is exceeded."""
STEPS: Final = 20


@dataclass(frozen=True, slots=True)
class RetentionPolicy:
    """Bounds of the archived data.

    Attributes:
        days: maximum age.
        megabytes: maximum size; old data is deleted first.
    """

    days: float = 30.0
    megabytes: float = 2000.0


async def run_retention(archive: Archive, retention: RetentionPolicy) -> None:
    """Delete data beyond the bounds periodically."""
    while True:
        try:
            deleted = await delete_old(archive, retention, archive.utc())
            if deleted:
                _LOG.info("%d archive rows beyond the retention bounds were deleted", deleted)
        except SQLAlchemyError as error:
            _LOG.error("old archive rows cannot be deleted: %s", error)
        await asyncio.sleep(CHECK_S)


async def delete_old(archive: Archive, retention: RetentionPolicy, utc_s: float) -> int:
    """Delete data beyond the age bound, then in order of age to the size bound; return the count.

    Deletion proceeds in steps, so that commands can be written between them.
    """
    cutoff_us = to_us(utc_s - retention.days * DAY_S)
    deleted = await _delete_before(archive, cutoff_us)
    max_octets = retention.megabytes * 1e6
    if await archive.read(_octets) <= max_octets:
        return deleted
    first_us = await archive.read(_first_utc_us)
    step_us = max((to_us(utc_s) - first_us) // STEPS, 1)
    while first_us < to_us(utc_s) and await archive.read(_octets) > REDUCTION_RATIO * max_octets:
        first_us += step_us
        deleted += await _delete_before(archive, first_us)
    return deleted


async def _delete_before(archive: Archive, rx_us: int) -> int:
    deleted = 0
    for parameter in await archive.read(find_parameters):
        deleted += await archive.write(
            partial(_delete_samples, parameter=parameter.id, rx_us=rx_us)
        )
    newest = select(func.max(NOTIFICATION.c.id)).group_by(NOTIFICATION.c.asset, NOTIFICATION.c.link)
    last = select(func.max(COMMAND.c.revision)).scalar_subquery()  # revisions continue from it
    for deleting in (
        NOTIFICATION.delete().where(NOTIFICATION.c.rx_us < rx_us, NOTIFICATION.c.id.not_in(newest)),
        COMMAND.delete().where(
            COMMAND.c.created_us < rx_us, COMMAND.c.ended == 1, COMMAND.c.revision < last
        ),
        RECORD.delete().where(RECORD.c.rx_us < rx_us),
        ALARM.delete().where(ALARM.c.acknowledged_us < rx_us, ALARM.c.open == 0),
    ):
        deleted += await archive.write(partial(_execute, deleting=deleting))
    return deleted


def _delete_samples(connection: Connection, parameter: int, rx_us: int) -> int:
    """Delete samples received before a time, also from their minutes."""
    old = (SAMPLE.c.parameter == parameter, SAMPLE.c.rx_us < rx_us)
    at = SAMPLE.c.utc_us
    first_us, last_us = connection.execute(select(func.min(at), func.max(at)).where(*old)).one()
    if first_us is None:
        return 0
    deleted = connection.execute(SAMPLE.delete().where(*old)).rowcount
    remake_minutes(connection, parameter, first_us, last_us)
    return deleted


def _execute(connection: Connection, deleting: Delete) -> int:
    return connection.execute(deleting).rowcount


def _octets(connection: Connection) -> float:
    count = connection.execute(select(func.count()).select_from(SAMPLE)).scalar_one()
    octets = float(count * SAMPLE_OCTETS)
    for table in (NOTIFICATION, COMMAND, RECORD):
        rows, bodies = connection.execute(
            select(func.count(), func.coalesce(func.sum(func.length(table.c.body)), 0))
        ).one()
        octets += rows * ROW_OCTETS + float(bodies)
    return octets


def _first_utc_us(connection: Connection) -> int:
    columns = (SAMPLE.c.rx_us, NOTIFICATION.c.rx_us, COMMAND.c.created_us, RECORD.c.rx_us)
    found = [connection.execute(select(func.min(column))).scalar() for column in columns]
    return min((each for each in found if each is not None), default=0)
