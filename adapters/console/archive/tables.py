"""The tables of the archive. Times are whole microseconds since 1970-01-01 UTC.

`utc_us` is by the clock aboard, `rx_us` by that of the console.

A change here needs a migration in `migrations/versions`, as docs/console.md shows.
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
"""A telemetry parameter of an asset, as heard by a link."""

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
"""A telemetry value: a number, or else a text; neither where it is not known."""

UNKNOWN: Final = and_(SAMPLE.c.value.is_(None), SAMPLE.c.text.is_(None))
"""Of a sample: that it is not known."""
Index(
    "ix_sample_unknown",
    SAMPLE.c.parameter,
    SAMPLE.c.utc_us,
    SAMPLE.c.value,  # for else SQLite would rather read all samples by their key
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
"""The lowest and the highest figure of each minute since 1970 UTC.

Of equal ones it is the first in time.
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
"""A notification, whole as the JSON that pages get; its cursor is 0 if it is not recorded there."""

COMMAND: Final = Table(
    "command",
    METADATA,
    Column("id", String(512), primary_key=True),
    Column("asset", String(256), nullable=False),
    Column("source", String(256), nullable=False),
    Column("number", BigInteger, nullable=False),
    Column("made_us", BigInteger, nullable=False),
    Column("ended", SmallInteger, nullable=False),
    Column("body", Text, nullable=False),
    Column("revision", BigInteger, nullable=False),
    Index(None, "made_us"),
    Index(None, "revision"),
    UniqueConstraint("asset", "source", "number"),
)
"""A command and its life so far, whole as the JSON that pages get.

`revision` counts up with each change of any command: so other consoles find what is new to them.
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
"""What else was told: modes, authority, links, plans, files, trees; as the JSON that pages get."""

OBJECT: Final = Table(
    "object",
    METADATA,
    Column("key", String(256), primary_key=True),
    Column("revision", Integer, nullable=False),
    Column("operator", String(256), nullable=False),
    Column("changed_us", BigInteger, nullable=False),
    Column("value", Text, nullable=False),
)
"""What operators made and share, such as a display; it is kept until one deletes it."""

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
"""Each revision of a plan that was submitted here."""

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
    Column("standing", SmallInteger, nullable=False),
    Index(None, "standing"),
    Index(None, "asset", "source"),
    Index(None, "raised_us"),
)
"""An alarm, from its first occurrence until it is both cleared and acknowledged, and after that."""

PRESENCE: Final = Table(
    "presence",
    METADATA,
    Column("instance", String(64), primary_key=True),
    Column("beat", BigInteger, nullable=False),
    Column("body", Text, nullable=False),
)
"""The pages that are open at a console; `beat` is another one as long as it runs."""
