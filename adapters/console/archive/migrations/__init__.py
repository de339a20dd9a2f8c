"""The steps by which Alembic brings the tables of an archive up to date."""
