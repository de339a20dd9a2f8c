"""Plans submitted at the console, with all revisions."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Connection, Row, select

from adapters.console.archive.archive import US_PER_S, to_us
from adapters.console.archive.tables import PLAN


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
    return [_revision(row) for row in connection.execute(chosen)]


def get_plan(connection: Connection, asset: str, revision: int) -> PlanRevision | None:
    """Return a revision; None if there is none."""
    chosen = select(PLAN).where(PLAN.c.asset == asset, PLAN.c.id == revision)
    row = connection.execute(chosen).first()
    return None if row is None else _revision(row, row.content)


def _revision(row: Row[Any], content: str = "") -> PlanRevision:
    return PlanRevision(
        row.asset, row.plan, row.id, row.command, row.operator, row.utc_us / US_PER_S, content
    )
