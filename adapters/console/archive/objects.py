"""Objects that operators make and share, such as displays: JSON values by key, with revisions.

A change names the revision that it changes. A change to an outdated revision is refused, so that
the operator reads the new one first.
"""

from dataclasses import dataclass
from typing import Final

from sqlalchemy import Connection, select

from adapters.console.archive.archive import to_us
from adapters.console.archive.tables import OBJECT

FIRST: Final = 1


@dataclass(frozen=True, slots=True)
class StoredObject:
    """A stored object.

    Attributes:
        value: its JSON text.
    """

    key: str
    revision: int
    operator: str
    value: str


@dataclass(frozen=True, slots=True)
class RevisionConflict:
    """A change names another revision than the stored one; None if there is no object."""

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
    """Create or change an object.

    Args:
        connection: connection of the writer thread.
        key: key of the object.
        value: its JSON text.
        revision: revision to change; None to create the object.
        operator: operator who changes it.
        utc_s: time of the change.
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
    """Delete an object of this revision; return a conflict if the stored one differs."""
    deleted = connection.execute(
        OBJECT.delete().where(OBJECT.c.key == key, OBJECT.c.revision == revision)
    )
    return None if deleted.rowcount else RevisionConflict(_revision(connection, key))


def _revision(connection: Connection, key: str) -> int | None:
    return connection.execute(select(OBJECT.c.revision).where(OBJECT.c.key == key)).scalar()
