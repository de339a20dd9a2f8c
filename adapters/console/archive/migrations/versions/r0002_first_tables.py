"""First revision of the tables: `tables.METADATA` makes new ones, so that it has no steps."""

revision = "0002"
down_revision = None


def upgrade() -> None:
    """Do nothing."""
