"""Stores and reads what operators make and share: objects by key (displays, ...), and plans.

Both have revisions. A change of an object names the revision that it changes. A change to an
outdated revision is refused, so that the operator reads the new one first.
"""

from dataclasses import dataclass
from typing import Any, Final

from sqlalchemy import Connection, Row, select

from adapters.console.archive.archive import US_PER_S, to_us
from adapters.console.archive.tables import OBJECT, PLAN

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


@dataclass(frozen=True, slots=True)
class PlanRevision:
    """A submitted plan.

    Attributes:
        revision: its number; later revisions have higher numbers.
        command: id of the command that submitted it.
        content: its XML; empty in a list.
    """

    asset: str
    plan: str
    revision: int
    command: str
    operator: str
    utc: float
    content: str = ""


def add_plan_revision(connection: Connection, revision: PlanRevision) -> None:
    """Store a submitted plan; the database assigns its revision."""
    connection.execute(
        PLAN.insert().values(
            asset=revision.asset,
            plan=revision.plan,
            command=revision.command,
            operator=revision.operator,
            utc_us=to_us(revision.utc),
            content=revision.content,
        )
    )


def list_plans(connection: Connection, asset: str) -> list[PlanRevision]:
    """Return all revisions of the plans of an asset, newest first, without their content."""
    columns = (each for each in PLAN.c if each is not PLAN.c.content)
    chosen = select(*columns).where(PLAN.c.asset == asset).order_by(PLAN.c.id.desc())
    return [_plan_revision(row) for row in connection.execute(chosen)]


def get_plan(connection: Connection, asset: str, revision: int) -> PlanRevision | None:
    """Return a revision; None if there is none."""
    chosen = select(PLAN).where(PLAN.c.asset == asset, PLAN.c.id == revision)
    row = connection.execute(chosen).first()
    return None if row is None else _plan_revision(row, row.content)


def _plan_revision(row: Row[Any], content: str = "") -> PlanRevision:
    return PlanRevision(
        row.asset, row.plan, row.id, row.command, row.operator, row.utc_us / US_PER_S, content
    )
