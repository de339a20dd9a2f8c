"""Migration that makes the first tables of the console's archive."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = None


def upgrade() -> None:
    """Migrate the tables to this revision."""
    op.create_table(
        "alarm",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("source", sa.String(length=256), nullable=False),
        sa.Column("severity", sa.String(length=16), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.Column("command", sa.String(length=512), nullable=True),
        sa.Column("raised_us", sa.BigInteger(), nullable=False),
        sa.Column("last_us", sa.BigInteger(), nullable=False),
        sa.Column("occurrences", sa.Integer(), nullable=False),
        sa.Column("cleared_us", sa.BigInteger(), nullable=True),
        sa.Column("operator", sa.String(length=256), nullable=True),
        sa.Column("acknowledged_us", sa.BigInteger(), nullable=True),
        sa.Column("open", sa.SmallInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_alarm")),
    )
    op.create_index(op.f("ix_alarm_asset_source"), "alarm", ["asset", "source"], unique=False)
    op.create_index(op.f("ix_alarm_raised_us"), "alarm", ["raised_us"], unique=False)
    op.create_index(op.f("ix_alarm_open"), "alarm", ["open"], unique=False)
    op.create_table(
        "command",
        sa.Column("id", sa.String(length=512), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("source", sa.String(length=256), nullable=False),
        sa.Column("number", sa.BigInteger(), nullable=False),
        sa.Column("created_us", sa.BigInteger(), nullable=False),
        sa.Column("ended", sa.SmallInteger(), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.Column("revision", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_command")),
        sa.UniqueConstraint(
            "asset", "source", "number", name=op.f("uq_command_asset_source_number")
        ),
    )
    op.create_index(op.f("ix_command_created_us"), "command", ["created_us"], unique=False)
    op.create_index(op.f("ix_command_revision"), "command", ["revision"], unique=False)
    op.create_table(
        "notification",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("link", sa.String(length=16), nullable=False),
        sa.Column("sequence", sa.BigInteger(), nullable=False),
        sa.Column("utc_us", sa.BigInteger(), nullable=False),
        sa.Column("rx_us", sa.BigInteger(), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.Column("cursor", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_notification")),
        sa.UniqueConstraint(
            "asset",
            "link",
            "cursor",
            "utc_us",
            name=op.f("uq_notification_asset_link_cursor_utc_us"),
        ),
    )
    op.create_index(op.f("ix_notification_utc_us"), "notification", ["utc_us"], unique=False)
    op.create_table(
        "object",
        sa.Column("key", sa.String(length=256), nullable=False),
        sa.Column("revision", sa.Integer(), nullable=False),
        sa.Column("operator", sa.String(length=256), nullable=False),
        sa.Column("changed_us", sa.BigInteger(), nullable=False),
        sa.Column("value", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_object")),
    )
    op.create_table(
        "parameter",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("key", sa.String(length=256), nullable=False),
        sa.Column("link", sa.String(length=16), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_parameter")),
        sa.UniqueConstraint("asset", "key", "link", name=op.f("uq_parameter_asset_key_link")),
    )
    op.create_table(
        "plan",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("plan", sa.String(length=256), nullable=False),
        sa.Column("command", sa.String(length=512), nullable=False),
        sa.Column("operator", sa.String(length=256), nullable=False),
        sa.Column("utc_us", sa.BigInteger(), nullable=False),
        sa.Column("content", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_plan")),
    )
    op.create_index(op.f("ix_plan_asset_id"), "plan", ["asset", "id"], unique=False)
    op.create_table(
        "presence",
        sa.Column("instance", sa.String(length=64), nullable=False),
        sa.Column("heartbeat", sa.BigInteger(), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("instance", name=op.f("pk_presence")),
    )
    op.create_table(
        "record",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("ty", sa.String(length=16), nullable=False),
        sa.Column("asset", sa.String(length=256), nullable=False),
        sa.Column("utc_us", sa.BigInteger(), nullable=False),
        sa.Column("rx_us", sa.BigInteger(), nullable=False),
        sa.Column("body", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_record")),
    )
    op.create_index(
        op.f("ix_record_ty_asset_utc_us"), "record", ["ty", "asset", "utc_us"], unique=False
    )
    op.create_index(op.f("ix_record_utc_us"), "record", ["utc_us"], unique=False)
    op.create_table(
        "sample",
        sa.Column("parameter", sa.Integer(), nullable=False),
        sa.Column("utc_us", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("rx_us", sa.BigInteger(), nullable=False),
        sa.Column("value", sa.Float(precision=53), nullable=True),
        sa.Column("text", sa.Text(), nullable=True),
        sa.Column("quality", sa.SmallInteger(), nullable=False),
        sa.ForeignKeyConstraint(["parameter"], ["parameter.id"], name=op.f("fk_sample_parameter")),
        sa.PrimaryKeyConstraint("parameter", "utc_us", name=op.f("pk_sample")),
        sqlite_with_rowid=False,
    )
    unknown = sa.text("value IS NULL AND text IS NULL")
    op.create_index(
        op.f("ix_sample_unknown"),
        "sample",
        ["parameter", "utc_us", "value", "text"],
        sqlite_where=unknown,
        postgresql_where=unknown,
    )
    op.create_table(
        "sample_minute",
        sa.Column("parameter", sa.Integer(), nullable=False),
        sa.Column("minute", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("low", sa.Float(precision=53), nullable=False),
        sa.Column("low_us", sa.BigInteger(), nullable=False),
        sa.Column("high", sa.Float(precision=53), nullable=False),
        sa.Column("high_us", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(
            ["parameter"], ["parameter.id"], name=op.f("fk_sample_minute_parameter")
        ),
        sa.PrimaryKeyConstraint("parameter", "minute", name=op.f("pk_sample_minute")),
        sqlite_with_rowid=False,
    )
