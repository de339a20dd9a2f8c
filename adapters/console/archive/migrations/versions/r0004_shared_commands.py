"""What the asset knows a command by, once each, and its revision."""

import json

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"

_NEW = (
    sa.Column("source", sa.String(length=256)),
    sa.Column("number", sa.BigInteger()),
    sa.Column("revision", sa.BigInteger()),
)


def upgrade() -> None:
    """Bring the tables to this revision."""
    for column in _NEW:
        op.add_column("command", column)
    _fill(op.get_bind())
    with op.batch_alter_table("command") as batch:
        for column in _NEW:
            batch.alter_column(column.name, existing_type=column.type, nullable=False)
        batch.create_unique_constraint(
            op.f("uq_command_asset_source_number"), ["asset", "source", "number"]
        )
    op.create_index(op.f("ix_command_revision"), "command", ["revision"], unique=False)


def _fill(connection: sa.Connection) -> None:
    """Take source and number from the JSON; of one that two consoles wrote, keep the posted one."""
    command = sa.table(
        "command",
        *(sa.column(name) for name in ("id", "made_us", "body")),
        *(sa.column(each.name, each.type) for each in _NEW),
    )
    known = set()
    rows = connection.execute(sa.select(command).order_by(command.c.made_us)).all()
    bodies = [(row.id, json.loads(row.body)) for row in rows]
    for name, body in sorted(bodies, key=lambda each: each[1]["args"] is None):
        identity = (body["asset"], body["source"], body["number"])
        this = command.c.id == name
        if identity in known:
            connection.execute(command.delete().where(this))
            continue
        known.add(identity)
        new = {"source": body["source"], "number": body["number"], "revision": len(known)}
        connection.execute(command.update().where(this).values(**new))
