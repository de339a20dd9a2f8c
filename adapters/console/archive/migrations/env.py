"""Runs migrations over the connection that the archive gives, as alembic wants it."""

from alembic import context

from adapters.console.archive.tables import METADATA

context.configure(
    connection=context.config.attributes["connection"],
    target_metadata=METADATA,
)
with context.begin_transaction():
    context.run_migrations()
