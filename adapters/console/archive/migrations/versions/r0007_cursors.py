"""The cursors of notifications, by which links catch up; of older ones their numbers.

Refusals without a number may have equal times: their cursors differ.
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"


def upgrade() -> None:
    """Bring the tables to this revision."""
    op.add_column("notification", sa.Column("cursor", sa.BigInteger()))
    op.execute("UPDATE notification SET cursor = sequence")
    with op.batch_alter_table("notification") as batch:
        batch.alter_column("cursor", existing_type=sa.BigInteger(), nullable=False)
        batch.drop_constraint(op.f("uq_notification_asset_link_sequence_utc_us"))
        batch.create_unique_constraint(
            op.f("uq_notification_asset_link_cursor_utc_us"), ["asset", "link", "cursor", "utc_us"]
        )
