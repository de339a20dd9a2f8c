"""Migration that adds the shelving of alarms."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"


def upgrade() -> None:
    """Migrate the tables to this revision."""
    op.add_column("alarm", sa.Column("shelved_us", sa.BigInteger(), nullable=True))
    op.add_column("alarm", sa.Column("shelved_until_us", sa.BigInteger(), nullable=True))
    op.add_column("alarm", sa.Column("shelved_by", sa.String(length=256), nullable=True))
    op.add_column("alarm", sa.Column("comment", sa.Text(), nullable=True))
