"""The lowest and the highest sample of each minute."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"

_FILL = """
INSERT INTO sample_minute
SELECT parameter, minute,
       max(CASE WHEN lowest = 1 THEN value END), max(CASE WHEN lowest = 1 THEN utc_us END),
       max(CASE WHEN highest = 1 THEN value END), max(CASE WHEN highest = 1 THEN utc_us END)
FROM (
    SELECT parameter, utc_us, value, utc_us / 60000000 AS minute,
           row_number() OVER (
               PARTITION BY parameter, utc_us / 60000000 ORDER BY value, utc_us
           ) AS lowest,
           row_number() OVER (
               PARTITION BY parameter, utc_us / 60000000 ORDER BY value DESC, utc_us
           ) AS highest
    FROM sample
    WHERE value IS NOT NULL AND utc_us >= 0
) AS ranked
GROUP BY parameter, minute
"""


def upgrade() -> None:
    """Bring the tables to this revision."""
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
    op.execute(_FILL)
