"""Alembic environment: runs migrations over the connection of the archive."""

from alembic import context

from adapters.console.archive.tables import METADATA

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
)
with context.begin_transaction():
    context.run_migrations()
