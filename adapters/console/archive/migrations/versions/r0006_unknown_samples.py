"""An index of the samples that are not known, which plots of long times show as gaps."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"


def upgrade() -> None:
    """Bring the tables to this revision."""
    unknown = sa.text("value IS NULL AND text IS NULL")
    op.create_index(
        op.f("ix_sample_unknown"),
        "sample",
        ["parameter", "utc_us", "value", "text"],
        sqlite_where=unknown,
        postgresql_where=unknown,
    )
