"""What operators make and share, such as displays: JSON values by their keys, with revisions.

A change names the revision that it changes. Who changes what another has changed meanwhile is
refused, and looks at the new one first.
"""

from dataclasses import dataclass
from typing import Final

from sqlalchemy import Connection, select

from adapters.console.archive.archive import to_us
from adapters.console.archive.tables import OBJECT

FIRST: Final = 1


@dataclass(frozen=True, slots=True)
class StoredObject:
    """An object.

    Attributes:
        value: as JSON.
    """

    key: str
    revision: int
    operator: str
    value: str


@dataclass(frozen=True, slots=True)
class RevisionConflict:
    """A change was refused: here is another revision than it names; None, there is no object."""

    revision: int | None


def list_objects(connection: Connection) -> list[tuple[str, int]]:
    """Return keys and revisions of all objects."""
    rows = connection.execute(select(OBJECT.c.key, OBJECT.c.revision).order_by(OBJECT.c.key))
    return [(row.key, row.revision) for row in rows]


def get_object(connection: Connection, key: str) -> StoredObject | None:
    """Return an object; None if there is none."""
    row = connection.execute(select(OBJECT).where(OBJECT.c.key == key)).first()
    return None if row is None else StoredObject(row.key, row.revision, row.operator, row.value)


def put_object(
    connection: Connection, key: str, value: str, revision: int | None, operator: str, utc_s: float
) -> StoredObject | RevisionConflict:
    """Make an object, or change it.

    Args:
        connection: of the one thread that writes.
        key: of the object.
        value: as JSON.
        revision: the one that is changed; None where there is to be none.
        operator: who changes it.
        utc_s: when.
    """
    row = {"value": value, "operator": operator, "changed_us": to_us(utc_s)}
    if revision is None:
        if (known := _revision(connection, key)) is not None:
            return RevisionConflict(known)
        connection.execute(OBJECT.insert().values(key=key, revision=FIRST, **row))
        return StoredObject(key, FIRST, operator, value)
    changed = connection.execute(
        OBJECT.update()
        .where(OBJECT.c.key == key, OBJECT.c.revision == revision)
        .values(revision=revision + 1, **row)
    )
    if changed.rowcount == 0:
        return RevisionConflict(_revision(connection, key))
    return StoredObject(key, revision + 1, operator, value)


def delete_object(connection: Connection, key: str, revision: int) -> RevisionConflict | None:
    """Delete an object, of this revision."""
    gone = connection.execute(
        OBJECT.delete().where(OBJECT.c.key == key, OBJECT.c.revision == revision)
    )
    return None if gone.rowcount else RevisionConflict(_revision(connection, key))


def _revision(connection: Connection, key: str) -> int | None:
    return connection.execute(select(OBJECT.c.revision).where(OBJECT.c.key == key)).scalar()
