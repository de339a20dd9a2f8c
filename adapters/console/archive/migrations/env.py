"""Alembic's `env.py` for the console's archive: runs migrations over the archive's connection."""

from alembic import context

from adapters.console.archive.tables import METADATA

context.configure(connection=context.config.attributes["connection"], target_metadata=METADATA)
with context.begin_transaction():
    context.run_migrations()
