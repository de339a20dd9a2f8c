"""Alembic migrations of the archive's tables.

The archive's `database` runs them at each start over its own connection: `env.py` calls the modules
of `versions/` that the archive has not applied. `script.py.mako` is the template of new modules.
"""
