"""The steps by which Alembic brings the tables of an archive up to date.

The archive's `database` runs them at each start over its own connection: `env.py` calls the modules
of `versions/` that the archive has not seen. A new module is made from `script.py.mako`.
"""
