"""The archive's tables (SQLAlchemy). Times are whole microseconds since 1970-01-01 UTC.

`utc_us` is the time of the onboard clock, `rx_us` that of the console's clock.

A change to the tables needs a migration in `migrations/versions`, as docs/console.md shows.
"""

from typing import Final

from sqlalchemy import (
    BigInteger,
    Column,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    SmallInteger,
    String,
    Table,
    Text,
    UniqueConstraint,
    and_,
)

METADATA: Final = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_N_name)s",
        "pk": "pk_%(table_name)s",
    }
)

PARAMETER: Final = Table(
    "parameter",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("key", String(256), nullable=False),
    Column("link", String(16), nullable=False),
    UniqueConstraint("asset", "key", "link"),
)
"""A telemetry parameter of an asset on one link."""

SAMPLE: Final = Table(
    "sample",
    METADATA,
    Column("parameter", ForeignKey("parameter.id"), primary_key=True),
    Column("utc_us", BigInteger, primary_key=True, autoincrement=False),
    Column("rx_us", BigInteger, nullable=False),
    Column("value", Float(53)),
    Column("text", Text),
    Column("quality", SmallInteger, nullable=False),
    sqlite_with_rowid=False,
)
"""A telemetry value: a number or a text; neither if unknown."""

UNKNOWN: Final = and_(SAMPLE.c.value.is_(None), SAMPLE.c.text.is_(None))
"""Condition for a sample with an unknown value."""
Index(
    "ix_sample_unknown",
    SAMPLE.c.parameter,
    SAMPLE.c.utc_us,
    SAMPLE.c.value,  # otherwise SQLite scans all samples by their key
    SAMPLE.c.text,
    sqlite_where=UNKNOWN,
    postgresql_where=UNKNOWN,
)

SAMPLE_MINUTE: Final = Table(
    "sample_minute",
    METADATA,
    Column("parameter", ForeignKey("parameter.id"), primary_key=True),
    Column("minute", BigInteger, primary_key=True, autoincrement=False),
    Column("low", Float(53), nullable=False),
    Column("low_us", BigInteger, nullable=False),
    Column("high", Float(53), nullable=False),
    Column("high_us", BigInteger, nullable=False),
    sqlite_with_rowid=False,
)
"""Minimum and maximum value of each minute since 1970 UTC.

Of equal values it is the first in time.
"""

NOTIFICATION: Final = Table(
    "notification",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("link", String(16), nullable=False),
    Column("sequence", BigInteger, nullable=False),
    Column("utc_us", BigInteger, nullable=False),
    Column("rx_us", BigInteger, nullable=False),
    Column("body", Text, nullable=False),
    Column("cursor", BigInteger, nullable=False),
    UniqueConstraint("asset", "link", "cursor", "utc_us"),
    Index(None, "utc_us"),
)
"""A notification, as the JSON of its message; the cursor is 0 if the asset does not record it."""

COMMAND: Final = Table(
    "command",
    METADATA,
    Column("id", String(512), primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("source", String(256), nullable=False),
    Column("number", BigInteger, nullable=False),
    Column("created_us", BigInteger, nullable=False),
    Column("ended", SmallInteger, nullable=False),
    Column("body", Text, nullable=False),
    Column("revision", BigInteger, nullable=False),
    Index(None, "created_us"),
    Index(None, "revision"),
    UniqueConstraint("asset", "source", "number"),
)
"""A command with its life cycle so far, as the JSON of its message.

`revision` increases with each change of any command, so other consoles find the changes.
"""

RECORD: Final = Table(
    "record",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("ty", String(16), nullable=False),
    Column("asset", String(256), nullable=False),
    Column("utc_us", BigInteger, nullable=False),
    Column("rx_us", BigInteger, nullable=False),
    Column("body", Text, nullable=False),
    Index(None, "ty", "asset", "utc_us"),
    Index(None, "utc_us"),
)
"""Other messages as JSON: modes, authority, links, plans, files, trees."""

OBJECT: Final = Table(
    "object",
    METADATA,
    Column("key", String(256), primary_key=True),
    Column("revision", Integer, nullable=False),
    Column("operator", String(256), nullable=False),
    Column("changed_us", BigInteger, nullable=False),
    Column("value", Text, nullable=False),
)
"""Objects that operators share, such as displays; kept until deleted by an operator."""

PLAN: Final = Table(
    "plan",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("plan", String(256), nullable=False),
    Column("command", String(512), nullable=False),
    Column("operator", String(256), nullable=False),
    Column("utc_us", BigInteger, nullable=False),
    Column("content", Text, nullable=False),
    Index(None, "asset", "id"),
)
"""Revisions of plans submitted at the console."""

ALARM: Final = Table(
    "alarm",
    METADATA,
    Column("id", Integer, primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("source", String(256), nullable=False),
    Column("severity", String(16), nullable=False),
    Column("text", Text, nullable=False),
    Column("command", String(512)),
    Column("raised_us", BigInteger, nullable=False),
    Column("last_us", BigInteger, nullable=False),
    Column("occurrences", Integer, nullable=False),
    Column("cleared_us", BigInteger),
    Column("operator", String(256)),
    Column("acknowledged_us", BigInteger),
    Column("open", SmallInteger, nullable=False),
    Column("shelved_us", BigInteger),
    Column("shelved_until_us", BigInteger),
    Column("shelved_by", String(256)),
    Column("comment", Text),
    Index(None, "open"),
    Index(None, "asset", "source"),
    Index(None, "raised_us"),
)
"""An open or closed alarm."""

PRESENCE: Final = Table(
    "presence",
    METADATA,
    Column("instance", String(64), primary_key=True),
    Column("heartbeat", BigInteger, nullable=False),
    Column("body", Text, nullable=False),
)
"""Open pages of a console; `heartbeat` changes while it runs."""
